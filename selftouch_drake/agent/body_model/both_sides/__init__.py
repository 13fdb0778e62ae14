"""Bodies from touches that both skins feel: *these two places met*, and both are unknown.

With places free on both sides any criterion of distances alone turns into canonical correlation: it
finds right distances and a wrong body. What fixes that is the *grain*: two receptors of one skin
that share touches are as far apart as the share says, in one unit for all skins, since a contact is
as wide on one skin as on the other (`grain.py`). Recordings of several pairs of skins share their
joints, and places and joints are fitted to all of them at once (`descent.py`, `problem.py`). The
search begins with one limb; another one begins as its mirror image (`search.py`, `orders.py`).

Joints are taken to turn, with readings in rad. Which joints carry which skin is given (`Layout`).
"""
