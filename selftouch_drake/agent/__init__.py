"""The naive agent: what it makes of its experience, what it knows of its body, how it plans."""
