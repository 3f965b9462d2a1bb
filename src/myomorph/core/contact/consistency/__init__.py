"""Whether plates, motion and body belong to each other: one test by the balance of momentum."""
