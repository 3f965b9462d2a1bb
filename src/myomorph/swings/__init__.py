"""Viscosity of joints and muscles from swinging limbs ([S]). Knows no other guest."""
