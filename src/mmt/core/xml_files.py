"""Parse untrusted XML; refuse document types, whose entities can expand without bound."""

import xml.etree.ElementTree as ET

from mmt.core.errors import InputError, short_message


class _PlainBuilder(ET.TreeBuilder):
    """Refuses a document type as soon as one is met, whatever the text's encoding."""

    def doctype(self, *_: object) -> None:
        """Refuse the document type before an entity is declared."""
        raise InputError("it declares a document type, which no such file does")


def parse_xml(content: bytes) -> ET.Element:
    """Return the root of a document.

    Raises
    ------
    InputError
        The content is no XML, is in an unknown encoding, or declares a document type; the
        message does not name the file.
    """
    parser = ET.XMLParser(target=_PlainBuilder())  # noqa: S314 - without entities
    try:
        parser.feed(content)
        root: ET.Element = parser.close()
    except (ET.ParseError, ValueError, LookupError) as error:  # of odd encodings as well
        raise InputError(f"it is no XML: {short_message(error)}") from error
    return root
