"""The body model: the agent's answer to whether each of its joints turns or slides something rigid.

It assumes *rigid links on joints that turn or slide*, and tests that on touches that it did not
learn from. Where the test fails the model is rejected, and the agent stays with the paper's
representation.
"""
