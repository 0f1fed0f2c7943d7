"""``python -m floatplan``."""

from floatplan.cli.commands import main

if __name__ == "__main__":
    main()
