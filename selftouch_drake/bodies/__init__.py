"""Bodies for the agent: worlds that Drake simulates, Gymnasium environments, and a user's own."""
