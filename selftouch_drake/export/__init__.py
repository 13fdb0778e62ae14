"""A body model as a robot of others: URDF, SDFormat and MJCF, with meshes and tables.

Numpy and arrays in, texts out: nothing here knows a run, and nothing of the agent knows this room.
"""
