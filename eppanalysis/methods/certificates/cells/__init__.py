"""All limit cycles by cells of a return map: how their certificates are found."""
