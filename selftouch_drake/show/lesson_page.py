"""The page of a lesson: what is known, and what to do next; a browser reloads it by itself."""

from html import escape
from pathlib import Path

from selftouch_drake.agent.lesson import Known, Step
from selftouch_drake.files import write_text_whole

# Seconds after which a browser looks again, and touches from which a receptor has its full colour.
_AGAIN_S, _FULL = 3, 10
_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta http-equiv="refresh" content="{again}">
<title>{title}</title><style>
body {{ font: 16px sans-serif; max-width: 60em; margin: 2em auto; color: #22262b }}
table {{ border-collapse: collapse }} td, th {{ padding: .2em 1em; text-align: left }}
ol {{ font-size: 1.3em }} .skin span {{ display: inline-block; width: 1.1em; height: 1.1em;
margin: 1px; border: 1px solid #d5d8dd }}
</style></head><body><h1>{title}</h1><p>{state}</p>
<h2>Next</h2><ol>{steps}</ol>
<h2>Joints</h2><table><tr><th>joint</th><th>does</th><th>axis</th><th>seen</th></tr>{joints}</table>
<h2>Receptors</h2><p>{share:.0%} felt enough; point at one to read its name.</p>
<p class="skin">{receptors}</p></body></html>
"""


def write_page(path: Path, title: str, known: Known, steps: list[Step]) -> None:
    """Writes the page, whole or not at all."""
    joints = "".join(
        f"<tr><td>{escape(joint.name)}</td><td>{joint.kind}</td><td>{error_text(joint.error_deg)}"
        f"</td><td>{joint.seen:.0%}</td></tr>"
        for joint in known.joints
    )
    receptors = "".join(
        f'<span style="background: rgba(0, 114, 178, {min(felt / _FULL, 1.0):.2f})" '
        f'title="{escape(name)}: {felt} touches"></span>'
        for name, felt in zip(known.names, known.felt.tolist(), strict=True)
    )
    text = _PAGE.format(
        again=_AGAIN_S,
        title=escape(title),
        state=escape(state_line(known)),
        steps="".join(f"<li>{escape(step.text)}</li>" for step in steps) or "<li>it is enough</li>",
        joints=joints,
        share=known.share_felt,
        receptors=receptors,
    )
    write_text_whole(path, text)


def state_line(known: Known) -> str:
    """What is known, in one line."""
    sure = sum(joint.is_known for joint in known.joints)
    if known.accepted:
        body = f"body accepted, {sure} of {len(known.joints)} joints known"
    else:
        body = f"no body yet: {known.reason.rstrip('.')}"
    return f"{known.num_touches:,} touches, {known.share_felt:.0%} of receptors felt; {body}"


def error_text(error_deg: float) -> str:
    """Standard error of an axis, or nothing."""
    return "" if error_deg != error_deg else f"± {error_deg:.1f}°"
