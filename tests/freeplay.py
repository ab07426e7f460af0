"""An aeroelastic section with freeplay in its control surface, at any air speed.

Conner, Tang, Dowell and Virgin, "Nonlinear behavior of a typical airfoil section with control surface freeplay", J.
Fluids Struct. 11, 1997; Theodorsen's aerodynamics with two lag states. States: heave [m], pitch [rad], surface angle
[rad], their rates, two lag states. Stiffness of the air goes with the square of the speed, damping with the speed.
"""

from __future__ import annotations

import numpy as np

import eppanalysis as epp

#: Half the freeplay [rad].
EDGE = 0.03700098014227979
#: Rates of the three speeds: at no air speed, and by the powers of it that follow.
_STILL = np.array([
    [-983.5504161043326, 88.43006377668, 0.0, -0.7711848053188, 0.05461942404036, -0.001378943331535, 0.0, 0.0],
    [6675.593566515965, -3820.325871958, 0.0, 5.234217016929, -2.359649986229, 0.1936287022137, 0.0, 0.0],
    [-4736.695503836434, 8810.667939727, 0.0, -3.713960708236, 5.441968350199, -2.959676272832, 0.0, 0.0],
])  # fmt: skip
_AIR = np.array([
    [0.0, -0.1717114863024, -0.04627490925489, -0.1717114863024, -0.02570956826748, -0.003055272366431,
     -0.1453197214971, -0.2921799385035],
    [0.0, 1.322215077433, -1.471500486134, 1.322215077433, -0.3634236274646, -0.1302052123023,
     1.118992858017, 2.249847860105],
    [0.0, -3.339252470046, -1.315860876999, -3.339252470046, -0.6277269227569, -0.6372485390989,
     -2.82601501743, -5.681987864385],
])  # fmt: skip
_POWERS = np.array([0, 2, 2, 1, 1, 1, 3, 2])
_SURFACE = np.array([-6.553537840557012, 920.2358051669968, -14066.096848376746])


def freeplay(speed: float) -> epp.LureSystem:
    """The section at an air speed [m/s]; the surface's spring acts outside the freeplay alone."""
    A = np.zeros((8, 8))
    A[[0, 1, 2], [3, 4, 5]] = A[6, 7] = 1.0
    A[3:6] = _STILL + _AIR * speed**_POWERS
    A[7] = [0.0, speed, 0.6089977810442 * speed, 1.0, 0.127, 0.02625703864446, 0.0, -2.720472440945 * speed]
    A[7, 6] = -0.8463016926034 * speed**2
    B, C = np.zeros((8, 1)), np.zeros((1, 8))
    B[3:6, 0], C[0, 2] = _SURFACE, 1.0
    start = np.zeros(8)
    start[2] = 0.1
    return epp.LureSystem.build(A, B, C, [epp.DeadZone(-EDGE, EDGE)], x0=start, name=f"freeplay at {speed} m/s")
