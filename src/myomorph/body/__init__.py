"""The body of one person: link lengths, marker positions, masses, muscles and sensors."""
