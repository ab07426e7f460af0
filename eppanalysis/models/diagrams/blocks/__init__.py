"""Linear blocks of a diagram by the kind that a case file gives them: controllers, filters, machines."""

from eppanalysis.models.diagrams.blocks.control import (
    BLOCKS as BLOCKS,
    PI as PI,
    PID as PID,
    Block as Block,
    Constant as Constant,
    DeadTime as DeadTime,
    Gain as Gain,
    Integrator as Integrator,
    LeadLag as LeadLag,
    LowPass as LowPass,
    Notch as Notch,
    Sensor as Sensor,
    StateSpaceBlock as StateSpaceBlock,
    TransferFunction as TransferFunction,
    ZeroPoleGain as ZeroPoleGain,
)
from eppanalysis.models.diagrams.blocks.machines import (
    CartPendulum as CartPendulum,
    Gear as Gear,
    Inertia as Inertia,
    Mass as Mass,
    Motor as Motor,
    Shaft as Shaft,
    WheeledPendulum as WheeledPendulum,
)
