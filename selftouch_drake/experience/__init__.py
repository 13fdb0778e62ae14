"""Random walks in motor space, and the experience that they collect, on disk."""
