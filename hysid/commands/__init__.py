"""The commands: their options as types, and what each does with them."""
