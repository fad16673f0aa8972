"""`python -m tvae` is `tvae`."""

from tvae.cli import main

main()
