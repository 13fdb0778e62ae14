"""A model of the body that somebody gives, put right by touch.

It is not naive: it begins with the tree and the axes of a file, in rad and metres. From the agent
it takes touches alone. What reads and writes files is elsewhere; here are arrays.
"""
