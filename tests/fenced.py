"""The fenced blocks of a Markdown page."""

import re

_FENCED = re.compile(r"^```(\w*)\n(.*?)^```$", flags=re.DOTALL | re.MULTILINE)


def blocks(text: str, *languages: str) -> list[str]:
    """The content of each block in one of the languages; the language of a plain one is ''."""
    return [content for language, content in _FENCED.findall(text) if language in languages]
