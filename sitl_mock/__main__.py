"""`python -m sitl_mock`."""

from sitl_mock.cli import main

if __name__ == "__main__":
    main()
