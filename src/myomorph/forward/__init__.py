"""Forward dynamics: how a body moves under its muscles, torques, passive forces and contacts."""
