"""What the paper says, with the place in it: the only numbers of the reproduction that are typed by hand.

Farrell, Weir, Heckathorne and Childress, J Rehabil Res Dev 42(5), 2005. Places are sections and figures, for the text
that was read carries no page numbers.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Said:
    """A statement of the paper.

    Attributes
    ----------
    place : str
        Section, figure or equation.
    text : str
        What it says, in short.
    value : float
        Its number, where there is one.
    """

    place: str
    text: str
    value: float = float("nan")


_FRICTION, _BACKLASH = "Results, Effect of Static Friction", "Results, Effect of Backlash"

SAID: dict[str, Said] = {
    "loaded speed": Said("Methods", "143 °/s with a load of 1.4 N·m at 16 V", 143.0),
    "own battery": Said("Methods", "60.7 °/s with a load of 1.4 N·m on the elbow's own 12 V battery", 60.7),
    "load": Said("Methods", "the load of both speeds, 1.4 N·m", 1.4),
    "battery": Said("Methods", "the elbow's own battery, 12 V", 12.0),
    "input range": Said("Methods; Figure 2", "input forces from 0 to 5 lb, in five bands", 5.0),
    "converter": Said("Methods", "12-bit data acquisition board", 12.0),
    "tray full": Said(f"{_FRICTION}; Figure 4(b)", "the original pulley's sensor reaches only 9 V at 5 lb", 9.0),
    "tray bearing": Said(f"{_FRICTION}; Figure 4(c)", "with the ball bearing it reaches 10 V at 5 lb", 10.0),
    "tray flat": Said(
        f"{_FRICTION}; Figure 4(b)",
        "while weights are removed the output stays constant for almost an entire pound",
        1.0,
    ),
    "four phases": Said(
        f"{_FRICTION}; Figure 5",
        "while the pulley sticks, the sensor keeps commanding flexion although the harness side may have fallen into "
        "parking or extension; after the slip it may command extension at once",
    ),
    "original pulley": Said(
        f"{_FRICTION}; Figure 6(a)",
        "with a range of about 1 lb and reduced backlash the original pulley oscillates after each of three steps",
        1.0,
    ),
    "ball bearing": Said(f"{_FRICTION}; Figure 6(b)", "a pulley with a ball bearing eliminates the limit cycle"),
    "large gap": Said(
        f"{_BACKLASH}; Equations (1), (2)", "a gap of about 2.5° changes the input force by about 1.25 lb", 1.25
    ),
    "small gap": Said(f"{_BACKLASH}; Equations (1), (2)", "a gap of less than 0.5° changes it by about 0.25 lb", 0.25),
    "quarter": Said(_BACKLASH, "1.25 lb are 25 percent of the input range", 25.0),
    "several bands": Said(f"{_BACKLASH}; Figure 2", "a change of 1 lb could span several of the bands", 1.0),
    "original gap": Said(
        f"{_BACKLASH}; Figure 8(a)", "the unmodified elbow (gap about 2.5°) oscillates after each of three steps", 2.5
    ),
    "reduced gap": Said(
        f"{_BACKLASH}; Figure 8(b)", "with the gap below 0.5° the limit cycle is eliminated, same profile", 0.5
    ),
    "gain": Said(_BACKLASH, "more gain brings the limit cycle back in the system with the reduced gap"),
    "stiffness": Said(_BACKLASH, "a smaller spring constant of the cable eliminates the limit cycle"),
    "mass": Said(_BACKLASH, "less mass at the end of the forearm makes limit cycles less likely"),
    "drift": Said(f"{_BACKLASH}; Figure 8", "a small drift, put down to the cord growing longer"),
    "upright": Said(
        "Discussion",
        "upright, too, removing backlash and friction makes it possible to eliminate the limit cycle",
    ),
    "both": Said("Conclusions", "backlash and static friction are primarily responsible for the limit cycle"),
    "stops": Said("Introduction, note", "the elbow oscillates for some time and, rarely, suddenly stops"),
    "parking": Said(
        "Methods",
        "a force held in the parking band for longer than a preset time parks the elbow until it exceeds F_high",
    ),
}
