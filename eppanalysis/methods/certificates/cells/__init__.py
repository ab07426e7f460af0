"""Absence of limit cycles by cells of a return map: how its certificates are found."""
