"""Text of strangers, made safe to show."""


def printable(text: str) -> str:
    """Escape control, direction and surrogate characters of untrusted text.

    Control characters could command a terminal, direction characters reverse the text beside them, and surrogates
    have no bytes.
    """
    return "".join(
        character
        if character.isprintable()
        else character.encode("unicode_escape", "surrogatepass").decode()
        for character in text
    )
