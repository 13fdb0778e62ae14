"""Practice: before a motion counts, the agent follows its plan slowly and repairs it.

`practise` is the entry. `sliding` feels, step by step, in a body without dynamics. `dry_run`
follows a plan and says where it would fail; `other_ways` searches slides and detours for those
steps. `touch_profile` feels beside a motion, for the touch servo. Nothing here moves the body under
dynamics: only a `Pilot` does.
"""

from selftouch_drake.agent.practice.practise import NoWayError as NoWayError
from selftouch_drake.agent.practice.practise import Practised as Practised
from selftouch_drake.agent.practice.practise import practise as practise
from selftouch_drake.agent.practice.practise import remembering as remembering
