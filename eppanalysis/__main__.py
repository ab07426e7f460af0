"""``python -m eppanalysis`` is the command ``eppanalysis``."""

from eppanalysis.cli import main

if __name__ == "__main__":
    main()
