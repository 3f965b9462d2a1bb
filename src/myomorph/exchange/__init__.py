"""Models, recordings and results for other programs: OpenSim's setups, MuJoCo, BIDS."""
