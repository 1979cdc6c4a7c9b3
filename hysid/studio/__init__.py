"""The page of `hysid studio`: a web server for this machine alone, over a folder of measurements."""
