"""Learning that never stops: the agent explores, learns, notices changes of its body, and adapts.

**What is expected.** From some thousand touches, a small network learns what is felt at which
motor configuration, and how firmly (`expectation`). It says what the body as the agent knows it
would feel.

**What surprises.** The surprise of a touch is how far what is felt is from what is expected. As
long as the body stays as it is, surprise stays as usual, however the agent explores. So the agent
adds up evidence that the body changed: the log of how much more likely each touch is in a body that
changed (`alarm`). Most changes show in the surprise of many touches. A receptor that falls silent
or begins to feel changes few touches, so each receptor has sums of its own: for readings that are
missing where they were surely expected, and for readings of one that never felt before. If a sum
passes what happens by chance once in ten million touches, the body changed; the touches since the
sum began to rise are those of the changed body.

**Which explanation is cheapest.** Two things can change between motor configurations and
sensations: the readings of receptors, and what the readings of joints mean. So the agent asks how
it would have to read its receptors and its joints for the changed body to feel what the old one
would have felt (`explanation`). It tries explanations from simple to complicated, until surprise is
as usual again:

1. *receptors:* some are silent, new, or changed places;
2. *one number for one joint:* its zero moved;
3. *a displacement:* all joints act as if they were elsewhere, by a smooth function of the
   configuration: a link grew, a skin slipped or stretched.

A more complicated explanation must lower surprise by a tenth more than the same kind of explanation
lowers it in touches from before the change, where there was nothing to explain.

**What becomes of what it knows.** An explanation turns touches from before the change into touches
of the changed body. A new learner takes these and the touches since, and the agent goes on: nothing
is forgotten that still holds. Nothing in this knows what a joint is, or its unit.
"""

from selftouch_drake.agent.lifelong.expectation import TouchSet
from selftouch_drake.agent.lifelong.explorer import Explorer, PostureSampler, Walker
from selftouch_drake.agent.lifelong.learner import OnlineLearner
from selftouch_drake.agent.lifelong.life import Life
from selftouch_drake.agent.lifelong.pairs import PairSeeker, TouchPairs

__all__ = [
    "Explorer",
    "Life",
    "OnlineLearner",
    "PairSeeker",
    "PostureSampler",
    "TouchPairs",
    "TouchSet",
    "Walker",
]
