"""Clients of camera systems that others wrote, against a server of oqtal.

usage: camera_clients.py CLIENT PORT BODY FRAMES
CLIENT: qtm-rt (Qualisys's own SDK), qualisys, vrpn, vrpn-callback, optitrack (libmotioncapture, which Crazyswarm2 uses),
natnet or natnet-unicast (the package natnet). PORT is the port that the client is told.

Connects, finds BODY, collects the poses of FRAMES frames, and prints one JSON document: names of the bodies, and for every frame its
number (null if the client does not tell it), the position in metres, and where the body's axes x, y and z point.

Run by mocap-emu/tests/peers.rs, with a Python interpreter that has requirements.txt installed.
"""

import asyncio
import json
import sys
import threading


def axes_of_quaternion(x, y, z, w):
    """Where the axes x, y and z of the body point, one after the other."""
    return [
        1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y),
        2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x),
        2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y),
    ]


async def qtm_rt_client(port, body, frames):
    import xml.etree.ElementTree as xml

    import qtm_rt

    connection = await qtm_rt.connect("127.0.0.1", port=port, version="1.25", timeout=30)
    if connection is None:
        sys.exit("qtm-rt did not connect")
    parameters = xml.fromstring(await connection.get_parameters(["6d"]))
    names = [name.text for name in parameters.findall("./The_6D/Body/Name")]
    collected, done = [], asyncio.get_running_loop().create_future()

    def on_packet(packet):
        _, bodies = packet.get_6d_residual()
        position, matrix, _ = bodies[names.index(body)]
        # The matrix is stored column by column.
        collected.append([packet.framenumber, [position.x * 1e-3, position.y * 1e-3, position.z * 1e-3], list(matrix.matrix)])
        if len(collected) == frames and not done.done():
            done.set_result(None)

    await connection.stream_frames(components=["6dres"], on_packet=on_packet)
    await asyncio.wait_for(done, 60 + frames)
    await connection.stream_frames_stop()
    connection.disconnect()
    return names, collected[:frames]


def motioncapture_client(kind, options, body, frames):
    import motioncapture

    connection = motioncapture.connect(kind, options)
    names, collected = set(), []
    while len(collected) < frames:
        connection.waitForNextFrame()
        bodies = connection.rigidBodies
        names.update(bodies)
        if body in bodies:
            pose = bodies[body]
            turn = pose.rotation
            collected.append([None, [float(x) for x in pose.position], axes_of_quaternion(turn.x, turn.y, turn.z, turn.w)])
    return sorted(names), collected


def natnet_client(port, body, frames, multicast):
    from natnet import NatNetClient

    client = NatNetClient(command_port=port, data_port=port + 1, use_multicast=multicast)
    described, collected, done = {}, [], threading.Event()

    def on_description(description):
        described.update({rigid.name: rigid.id_num for rigid in description.rigid_bodies})

    def on_frame(frame):
        if body in described and len(collected) < frames:
            rigid = next(rigid for rigid in frame.rigid_bodies if rigid.id_num == described[body])
            axes = axes_of_quaternion(*rigid.rot)
            collected.append([frame.prefix.frame_number, list(rigid.pos), axes])
        if len(collected) == frames:
            done.set()

    client.on_data_description_received_event.handlers.append(on_description)
    client.on_data_frame_received_event.handlers.append(on_frame)
    with client:
        client.request_modeldef()
        client.run_async()
        complete = done.wait(60 + frames)
        client.stop_async()
    if not complete:
        sys.exit(f"{len(collected)} of {frames} frames came")
    return sorted(described), collected


def main():
    client, port, body, frames = sys.argv[1], int(sys.argv[2]), sys.argv[3], int(sys.argv[4])
    if client == "qtm-rt":
        names, collected = asyncio.run(qtm_rt_client(port, body, frames))
    elif client == "qualisys":
        # The client is told the first port of the server; the little-endian one is the next.
        options = {"hostname": "127.0.0.1", "port": str(port - 1)}
        names, collected = motioncapture_client("qualisys", options, body, frames)
    elif client == "vrpn":
        names, collected = motioncapture_client("vrpn", {"hostname": f"tcp://127.0.0.1:{port}"}, body, frames)
    elif client == "vrpn-callback":
        names, collected = motioncapture_client("vrpn", {"hostname": f"127.0.0.1:{port}"}, body, frames)
    elif client == "optitrack":
        names, collected = motioncapture_client("optitrack", {"hostname": "127.0.0.1", "interface_ip": "127.0.0.1"}, body, frames)
    elif client in ("natnet", "natnet-unicast"):
        names, collected = natnet_client(port, body, frames, client == "natnet")
    else:
        sys.exit(f"unknown client {client}")
    print(json.dumps({"bodies": names, "frames": collected}), flush=True)


main()
