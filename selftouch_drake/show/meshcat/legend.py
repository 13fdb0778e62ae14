"""A page of Meshcat's with a title and a legend, whose scene fits into any window."""

import html
from collections.abc import Sequence

# How far the scene moves to the left, as a share of the height of the window, where there is room:
# Meshcat's controls open at the right.
_ASIDE = 0.13
# Meshcat keeps the height of a scene: on a page that is narrower than it is high, what stands
# beside the robot would leave the screen. This ratio of width to height shows all of it.
WIDE = 1.5


def with_legend(
    page: str,
    title: str,
    text: str,
    colors: Sequence[tuple[str, str]] = (),
    *,
    wide: float = WIDE,
    beside: bool = False,
) -> str:
    """A page of Meshcat's with its title, and over it what its colours mean.

    Args:
        page: HTML.
        title: of the page.
        text: a sentence or two below it.
        colors: and what each stands for.
        wide: width over height that the scene needs: on narrower screens, it becomes smaller.
        beside: whether the scene moves to the left on wider screens, where controls open.
    """
    title, aside = html.escape(title), _ASIDE if beside else 0.0
    entries = "".join(
        f'<li style="margin-right: .8em"><span style="color: {color}">&#9679;</span> '
        f"{html.escape(meaning)}</li>"
        for color, meaning in colors
    )
    legend = f"""
  <style>
    #legend {{ position: fixed; left: 1rem; top: 1rem; width: min(22rem, 100vw - 2rem);
              color: #22262b; font: 14px/1.4 system-ui, sans-serif; pointer-events: none }}
    #legend ul {{ display: flex; flex-wrap: wrap; list-style: none; margin: .3em 0; padding: 0 }}
    /* Below Meshcat's button for its controls. */
    @media (max-width: 40rem) {{ #legend {{ top: 2rem; font-size: 12px }} }}
  </style>
  <div id="legend"><strong>{title}</strong><br>{html.escape(text)}<ul>{entries}</ul></div>
  <script>
    function fitScene() {{
      viewer.camera.zoom = Math.min(1, innerWidth / innerHeight / {wide});
      const aside = innerWidth / innerHeight > {wide} ? {aside} * innerHeight : 0;
      viewer.camera.setViewOffset(innerWidth, innerHeight, aside, 0, innerWidth, innerHeight);
      viewer.set_dirty();
    }}
    addEventListener("resize", fitScene);
    fitScene();
  </script>
"""
    page = page.replace("<title>Drake MeshCat</title>", f"<title>{title}</title>", 1)
    head, end, tail = page.rpartition("</body>")
    return head + legend + end + tail
