"""Every model but the Preisach family, one file each."""
