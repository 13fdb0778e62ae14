"""The paper, readable alone.

V. Marcel, S. Argentieri, B. Gas: Building and exploiting a sensorimotor representation of a naive
agent self-interaction.

A naive agent sends motor configurations M and receives sensations S = Psi(M) = phi(f(M)). It knows
neither the forward kinematics f, nor the sensory function phi, nor the pose X = f(M) in between.
From the relation M1 =_Psi M2, "both feel alike", it builds M/=_Psi, and by the paper's theorem that
space stands for X/=_phi, what it touches. Read in this order:

1. `sensations`, `kernels`: target sensations, and motor kernel sets, the points of M/=_Psi.
2. `distances`, `scale`, `graph`, `paths`: distances between these points, and a graph over them.
3. `learn`: all of that from the `experience`. It makes a `representation`.
4. `lengths`, `layout`, `holes`, `alpha`, `surface`, `dimension`, `body`: what the graph says about
   the body.
5. `links`, `firm`, `route`, `waypoints`, `smooth`, `plan`: motions from any sensation to any other.

`threads` and `records` are tools. Nothing here knows more than arrays: what a body with several
parts, hands or habits needs beside the paper hands it arrays or functions.
"""

from .body import Shape as Shape
from .body import recover as recover
from .learn import learn as learn
from .plan import MotorPath as MotorPath
from .plan import Ways as Ways
from .plan import plan as plan
from .representation import Representation as Representation
