"""The main job: a model, a recording, coordinates, torques, muscles, contacts and tensions. Knows no other wing."""
