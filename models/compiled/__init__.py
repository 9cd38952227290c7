"""Models compiled to one loop over directions: a formula's JAX trace, written as vector code of this processor."""
