"""A replay that is watched in the rerun viewer while it goes on."""

from __future__ import annotations

from preshape.hal.recording import Recording
from preshape.tools.controller_setup import ControllerSetup
from preshape.tools.replay import Replayed, replay


def replayed_and_shown(recording: Recording, setup: ControllerSetup) -> Replayed:
    """Replay a recording and draw the replayed ticks; returns when the viewer is closed, or by Ctrl-C after the end."""
    from preshape.tools.dash_recording import RecordingDrawer
    from preshape.tools.rerun_layout import blueprint
    from preshape.tools.rerun_stream import RerunStream
    from preshape.tools.rerun_viewer import RerunViewer

    with RerunViewer(web=False) as viewer:
        print(f"showing the replay{viewer.where}", flush=True)
        drawer = RecordingDrawer(recording, RerunStream.to_viewer(viewer.url, blueprint(live=True)))
        result = replay(recording, setup, [drawer])
        drawer.close()
        print("replayed; close the viewer, or Ctrl-C, to go on", flush=True)
        try:
            viewer.wait()
        except KeyboardInterrupt:
            return result
    return result
