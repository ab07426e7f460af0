"""More curves without memory: tables, springs with freeplay, quantisers that round down, smooth ones."""
