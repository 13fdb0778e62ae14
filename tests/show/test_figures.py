import matplotlib as mpl
import numpy as np
import pytest
import trimesh
from conftest_show import make_run
from matplotlib.image import imread

from selftouch_drake.show import FIGURES, write_figures
from selftouch_drake.show.experience_figures import touch_density
from selftouch_drake.show.graph_figures import spectral_order
from selftouch_drake.show.material import Material
from selftouch_drake.show.motion_figures import evenly_spaced
from selftouch_drake.show.scene import View, visible
from selftouch_drake.show.sensation_figures import far_apart


@pytest.fixture(scope="module")
def figures(executed_run):
    before = dict(mpl.rcParams)
    skipped = {}
    written = write_figures(executed_run, skipped=skipped.__setitem__)
    assert skipped == {}
    assert dict(mpl.rcParams) == before
    return {path.stem: imread(path) for path in written}
