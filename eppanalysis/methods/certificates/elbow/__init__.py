"""Absence of limit cycles of the powered elbow with a small gap: how its certificates are found."""
