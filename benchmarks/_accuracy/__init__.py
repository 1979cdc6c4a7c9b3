"""What the held-out errors on measured data are worth: verdicts beside them; creep and relaxation."""
