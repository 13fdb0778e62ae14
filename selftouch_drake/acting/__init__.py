"""The agent in the world: timing of its plans, and their execution."""
