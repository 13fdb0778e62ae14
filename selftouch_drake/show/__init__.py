"""What a person looks at: figures, the report, recordings (Meshcat)."""

from selftouch_drake.show.figures import FIGURES, write_figures
from selftouch_drake.show.live import play
from selftouch_drake.show.material import MissingError
from selftouch_drake.show.playback import write_playback
from selftouch_drake.show.readings import Reading, headline, readings
from selftouch_drake.show.report import write_report

__all__ = [
    "FIGURES",
    "MissingError",
    "Reading",
    "headline",
    "play",
    "readings",
    "write_figures",
    "write_playback",
    "write_report",
]
