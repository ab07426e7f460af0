"""Values of a case file: quantities, named parameters, and expressions of them."""
