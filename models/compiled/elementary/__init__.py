"""Elementary functions as vector code: exponentials, logarithms, sines, powers, and what they are made of."""
