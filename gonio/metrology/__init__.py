"""Quantities that standards ask for, and where their uncertainty comes from [JCGM 100:2008, JCGM 101:2008]."""
