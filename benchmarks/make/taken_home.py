"""A body beside its export, in Meshcat and in MuJoCo, all in one posture and seen from one side.

`benchmarks/make/pictures.py` draws it as `taken_home.png`.
"""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from PIL import Image
from pydrake.geometry import Cylinder, Meshcat, MeshcatVisualizer, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.systems.framework import DiagramBuilder

from selftouch_drake.bodies.embodiment import World
from selftouch_drake.evaluation.body_model import Similarity
from selftouch_drake.run.directory import RunDirectory
from selftouch_drake.run.exported import Known, export_model
from selftouch_drake.show.meshcat.stage import open_meshcat

sys.path.append(str(Path(__file__).parents[2]))  # for `benchmarks`
