"""Force plates: what a recording holds of them, as forces on the bodies that stand on them."""
