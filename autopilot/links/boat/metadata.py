"""Where ground stations find the description of our parameters: COMPONENT_METADATA, and its older form."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from autopilot.links.boat.file_server import checksum
from autopilot.links.extra_messages import ComponentInformation, ComponentMetadata
from autopilot.links.mavlink_codec import Message

GENERAL = "/general.json"
"""The file that names all others; served over MAVLink FTP like them."""
NO_FILES: Mapping[str, bytes] = MappingProxyType({})


def metadata_messages(identity: int, general: bytes | None) -> list[Message]:
    """Return the message `identity` that says where the file `general` is; nothing where there is none."""
    if general is None:
        return []
    uri, crc = f"mftp://{GENERAL}".encode(), checksum(general)
    if identity == ComponentMetadata.id:
        return [ComponentMetadata(0, crc, uri)]
    return [ComponentInformation(0, crc, uri, 0, b"")] if identity == ComponentInformation.id else []
