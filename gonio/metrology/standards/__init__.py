"""Quantities that standards name: integrals of f over apertures of light and detector, and what is made of them."""
