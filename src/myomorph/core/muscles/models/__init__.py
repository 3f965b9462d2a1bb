"""Classes of muscles, a file each: their curves and parameters."""
