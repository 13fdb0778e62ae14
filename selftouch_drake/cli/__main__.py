"""Makes `python -m selftouch_drake.cli` do what `selftouch` does."""

from selftouch_drake.cli import main

if __name__ == "__main__":
    main()
