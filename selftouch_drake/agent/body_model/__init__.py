"""A model of the agent's own body, found from touch alone.

It costs one assumption: *rigid links on joints that turn or slide*. `judge` tests it on touches
that no fit has seen.
"""
