"""The page about the viscosity of specimens."""
