"""All roots of the DF balance in a box: how their certificates are found."""
