"""`hysid init`: what the columns of an unknown file are."""
