"""What a person looks at: figures and the report (page), recordings and live play (meshcat)."""

from selftouch_drake.show.material import Material, MissingError
from selftouch_drake.show.meshcat.live import LiveShow, play_live
from selftouch_drake.show.meshcat.recording_page import recording_page
from selftouch_drake.show.page.figures import FIGURES, draw_figures
from selftouch_drake.show.page.report import Picture, Recording, report_page

__all__ = [
    "FIGURES",
    "LiveShow",
    "Material",
    "MissingError",
    "Picture",
    "Recording",
    "draw_figures",
    "play_live",
    "recording_page",
    "report_page",
]
