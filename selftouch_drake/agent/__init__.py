"""The naive agent: its representation, its recovered body, its plans."""
