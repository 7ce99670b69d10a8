"""Fast DDS by UDP on the loopback alone."""

from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
LOOPBACK_ONLY = "<interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>"


def write_loopback_profile(folder: Path) -> Path:
    """Write a profile, and return where it is: `fastdds_udp.xml` without other interfaces.

    For processes with a wider range of discovery than LOCALHOST, which brings shared memory back.
    """
    udp = (REPOSITORY / "config" / "fastdds_udp.xml").read_text()
    profile = folder / "fastdds_loopback.xml"
    profile.write_text(udp.replace("<type>UDPv4</type>", f"<type>UDPv4</type>{LOOPBACK_ONLY}"))
    return profile
