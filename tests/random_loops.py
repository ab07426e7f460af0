"""Random loops for the engine's tests: 2 to 10 states, stable and unstable, closed by one to three random elements."""

from __future__ import annotations

import numpy as np

import eppanalysis as epp


def random_element(rng: np.random.Generator) -> epp.Nonlinearity:
    """One element with parameters of order one."""
    a, b = rng.uniform(0.2, 1.5, 2)
    choices = (
        lambda: epp.Saturation(-a, b, 1.0 + a),
        lambda: epp.DeadZone(-a, b, 1.0),
        lambda: epp.Relay(-a, b, rng.normal() * 0.2),
        lambda: epp.RelayDeadZone(a, b),
        lambda: epp.Preload(a, b),
        lambda: epp.Quantiser(a, 6),
        lambda: epp.HysteresisRelay(-a, b, -b, a),
        lambda: epp.HysteresisRelayDeadZone(a + b, a, b),
        lambda: epp.Play(2 * a),
        lambda: epp.JumpAndFollow(a + b, a * rng.uniform(), 1.0),
        lambda: epp.FiveBandLaw(-a - b, -a, b, b + 1.0, 2.0),
        lambda: epp.LockPin(a, 5 * b, rng.uniform(0, 1), "unilateral" if rng.random() < 0.7 else "classical"),
        lambda: epp.Friction(a, a * (1 + rng.uniform())),
        lambda: epp.StictionPulley(1.0 + a, 2.0 + b, 0.3 * rng.uniform(0.1, 1), rng.uniform(0.2, 1)),
    )
    return choices[rng.integers(len(choices))]()


def random_loop(seed: int) -> epp.LureSystem:
    """The loop of a seed: the same one for ever."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 11))
    elements = [random_element(rng) for _ in range(int(rng.integers(1, 4)))]
    nz, nw = sum(e.n_inputs for e in elements), sum(e.n_outputs for e in elements)
    A = _matrix(rng, n)
    B, C = rng.normal(size=(n, nw)), rng.normal(size=(nz, n))
    row = 0
    for e in elements:
        if e.n_inputs == 2:
            # The second input is the rate of the first, which no output may reach directly.
            B -= np.outer(C[row], C[row] @ B) / (C[row] @ C[row])
            C[row + 1] = C[row] @ A
        row += e.n_inputs
    return epp.LureSystem.build(A, B, C, elements, x0=rng.normal(size=n) * 2.0, name=f"random loop {seed}")


def _matrix(rng: np.random.Generator, n: int) -> np.ndarray:
    """Real matrix with modes between 0.3 and 10 rad/s, most of them damped."""
    blocks, k = np.zeros((n, n)), 0
    while k < n:
        speed, damping = np.exp(rng.uniform(np.log(0.3), np.log(10.0))), rng.uniform(-0.05, 0.9)
        if k + 1 < n and rng.random() < 0.6:
            blocks[k : k + 2, k : k + 2] = [[-damping * speed, speed], [-speed, -damping * speed]]
            k += 2
        else:
            blocks[k, k] = 0.0 if rng.random() < 0.1 else -speed * damping
            k += 1
    T = np.linalg.qr(rng.normal(size=(n, n)))[0] * np.exp(rng.normal(size=n) * 0.3)
    return T @ blocks @ np.linalg.inv(T)
