"""Many runs of experiments that differ in a few fields, and what their metrics show together."""
