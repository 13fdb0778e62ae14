"""The paper, readable alone.

V. Marcel, S. Argentieri, B. Gas: Building and exploiting a sensorimotor representation of a naive
agent self-interaction.

A naive agent sends motor configurations M and receives sensations S = Psi(M) = phi(f(M)). It knows
neither the forward kinematics f, nor the sensory function phi, nor the pose X = f(M) in between.
From the relation M1 =_Psi M2, "both feel alike", it builds M/=_Psi, and by the paper's theorem that
space stands for X/=_phi, what it touches. Read in this order, in which each file needs only those
before it:

1. `sensations`, `kernels`: target sensations, and motor kernel sets, the points of M/=_Psi.
2. `distances`, `scale`, `paths`, `representation`, `graph`: distances between these points, and a
   graph over them; what the agent keeps of both.
3. `checks`, `learn`: all of that from arrays.
4. `lengths`, `layout`, `alpha`, `holes`, `dimension`, `body`: what the graph says about
   the body.
5. `links`, `firm`, `route`, `waypoints`, `smooth`, `plan`: motions from any sensation to any other.

`threads` are tools. Nothing here knows more than arrays: what a body with several
parts, hands or habits needs beside the paper hands it arrays or functions.

Sensations S are `sensation`, motor configurations M are `q`, in the robot's units. Scaled ones are
`x`: `q` times a factor for each joint (`scale`). Their unit is the *motor unit*, mu. A distance
between sensations is often counted in *spacings*, the distance between neighbouring targets.

What a tuned constant trades stands beside it. What half and twice its value change is in the table
`docs/data/constants.csv`, on a cube with six joints and a torus with nine: *shape* is the error of
the recovered shape, in % of the extent of the body; *contact* is the share of the length of plans
on which something is felt. The command is
`python benchmarks/accuracy/constants.py runs/cube_0 runs/turning_body_5 --pairs 20`.
"""

from .body import Shape as Shape
from .body import recover as recover
from .learn import learn as learn
from .plan import MotorPath as MotorPath
from .plan import PlanningGraph as PlanningGraph
from .plan import plan as plan
from .representation import Representation as Representation
