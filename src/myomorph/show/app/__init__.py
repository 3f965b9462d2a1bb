"""`myomorph app`: a page on this machine that takes recordings and opens the answer."""
