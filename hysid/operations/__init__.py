"""What the commands do: plain data in, plain data out."""
