"""`python -m service` is the command `thermogate`, wherever the package is imported from."""

from service.cli.main import main

if __name__ == "__main__":
    raise SystemExit(main())
