"""``python -m vdfmu.cli``."""

from vdfmu.cli import main

if __name__ == "__main__":
    main()
