"""Bones that come over a socket on this machine, as from a game or a tracker: a line of JSON for each pose.

Whoever has bones sends them as they come, faster or slower than the physics steps; it takes the newest ones. Here a
thread stands for the tracker. No pose is older than a message takes, and none makes the physics wait.
"""

import json
import socket
import threading
import time

import numpy as np

import cape

REST = {"hand": ([0.0, 0.0, 1.5], [1.0, 0.0, 0.0, 0.0])}  # position [m], quaternion bone_to_world wxyz


class Newest:
    """The bones that came last."""

    def __init__(self, port):
        self.bones = REST
        self.received = 0
        threading.Thread(target=self.receive, args=(port,), daemon=True).start()

    def receive(self, port):
        with socket.create_connection(("127.0.0.1", port)) as there, there.makefile("r") as lines:
            for line in lines:
                self.bones = json.loads(line)
                self.received += 1

    def __call__(self, seconds):
        return self.bones


def track(server):
    """A hand that waves, sent 90 times a second."""
    there, _ = server.accept()
    with there:
        for k in range(180):
            hand = [0.0, 0.15 * np.sin(2.0 * np.pi * k / 90.0), 1.5]
            there.sendall(json.dumps({"hand": (hand, [1.0, 0.0, 0.0, 0.0])}).encode() + b"\n")
            time.sleep(1 / 90)


with socket.create_server(("127.0.0.1", 0)) as server:  # on loopback: nobody else reaches it
    threading.Thread(target=track, args=(server,), daemon=True).start()
    newest = Newest(server.getsockname()[1])
    cloth = cape.Cloth.rectangle(width=0.4, height=0.4, spacing=0.05, origin=(0.0, 0.2, 1.5))
    scene = cape.Scene(cloth, [cape.attach(cloth, "hand", "top")], wind=cape.Wind())
    with cape.Live(scene, newest, viewer="none", keep=True) as live:
        live.wait(2.0)
waved = np.ptp(live.take().bones.positions[:, 0, 1])
print(f"{newest.received} poses came, the hand moved by {waved:.2f} m")
