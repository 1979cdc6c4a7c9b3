"""First-order reversal curves: branches, diagram, Everett surface."""
