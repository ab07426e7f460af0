"""All roots of the first-order balance in a box: how their certificates are found."""
