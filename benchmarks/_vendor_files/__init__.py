"""Files in the layouts of rig makers, with made-up numbers, and what reading them has to give."""
