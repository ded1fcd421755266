"""Maps: linear models of the landing, their bootstrap, subspaces and distances."""
