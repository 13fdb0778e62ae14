"""The naive agent: it learns from experience, recovers its body and plans."""
