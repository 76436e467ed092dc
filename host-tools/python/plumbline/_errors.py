"""What cannot be used, as an exception."""


class BadInput(ValueError):
    """A file, a device or an argument that cannot be used.

    Attributes:
        place: the file as it was given, the device, or the function whose argument it is.
        field: the field, line or argument within it; empty where the whole is meant.
        found: what was found there.
        remedy: what to do next.
    """

    def __init__(self, place: str, field: str, found: str, remedy: str) -> None:
        super().__init__(place, field, found, remedy)
        self.place = place
        self.field = field
        self.found = found
        self.remedy = remedy

    def __str__(self) -> str:
        where = f"{self.place}: {self.field}" if self.field else self.place
        return f"{where}: {self.found}; {self.remedy}"
