"""Diagrams: linear blocks and elements with named ports, wired by name, and the loop that they close."""

from eppanalysis.models.diagrams import blocks as blocks
from eppanalysis.models.diagrams.blocks import BLOCKS as BLOCKS, Block as Block
from eppanalysis.models.diagrams.diagram import Diagram as Diagram
