"""The main job: a model, a recording, coordinates, torques, muscles, contacts, tensions."""
