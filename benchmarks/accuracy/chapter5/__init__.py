"""[D] chapter 5 by files and commands alone: simulated recordings, one study file each, truth beside results."""
