"""`label RECORDING`: a browser page in which boxes are drawn on key frames, and interpolated between them."""

from __future__ import annotations

import argparse
import tempfile
import webbrowser
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from html import escape
from pathlib import Path
from typing import get_args

from rich.console import Console

from etd_ros.commands.recording_options import add_recording_options
from etd_ros.labelling import LabelServer, LabelSession, make_pictures
from etd_ros.labelling.pictures import PictureKind
from etd_ros.output_files import check_outputs
from etd_ros.recordings import open_recording


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the command line."""
    parser = subparsers.add_parser("label", help="draw box labels in a browser", description=__doc__)
    add_recording_options(parser)
    parser.add_argument(
        "--output", type=Path, required=True, metavar="BOXES.csv", help="the labels; work on them goes on if it exists"
    )
    parser.add_argument(
        "--on", choices=get_args(PictureKind), help="what to draw on (default: video frames where there are any)"
    )
    parser.add_argument("--rate", type=float, default=30.0, metavar="HZ", help="reconstructions a second (default: 30)")
    parser.add_argument("--port", type=int, default=0, help="of the page, on this machine alone (default: a free one)")
    parser.add_argument("--no-browser", action="store_true", help="print the page's address only")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Prepare the pictures and serve the page until Ctrl-C.

    Raises:
        LabellingError: no pictures, or labels that cannot be continued.
    """
    check_outputs(options.output)
    with ExitStack() as stack:
        with (
            open_recording(options.recording, topic=options.topic, size=options.size) as recording,
            Console(stderr=True).status("preparing the pictures"),
        ):
            pictures = stack.enter_context(make_pictures(recording, options.on, rate_hz=options.rate))
        session = LabelSession(pictures.stamps, pictures.width, pictures.height, options.output)
        title = options.recording.resolve().name
        server = stack.enter_context(closing(LabelServer(session, pictures, title=title, port=options.port)))
        try:
            print(f"{len(pictures)} {pictures.kind} pictures of {title}: {server.url} (Ctrl-C ends)", flush=True)
            if not options.no_browser:
                webbrowser.open(stack.enter_context(_way_to(server.url)))
            server.serve()
        except KeyboardInterrupt:
            print()
        print(_outcome(session))
    return 0


def _outcome(session: LabelSession) -> str:
    if not session.is_saved:
        return f"not saved, but kept in {session.keys_path}: run the same command to go on"
    return f"saved: {session.output}" if session.output.exists() else "nothing labelled"


@contextmanager
def _way_to(url: str) -> Iterator[str]:
    """The address of a file that leads to the page: other users of the machine can read command lines, but not this."""
    with tempfile.NamedTemporaryFile("w", prefix="etd_ros_label_", suffix=".html") as file:
        file.write(f'<meta http-equiv="refresh" content="0; url={escape(url)}">')
        file.flush()
        yield Path(file.name).as_uri()
