"""Non-negative linear fits: Preisach weights and compositions."""
