"""A stand-in of a magnetic skin on TCP: 5 chips, each a temperature and three fields as little-endian floats, then CR LF."""

import socket
import struct
import sys
import time

HZ = 200.0


def main(first_ut):
    with socket.create_server(("127.0.0.1", 0)) as server:
        print("%s:%d" % server.getsockname(), flush=True)
        while True:
            client, _ = server.accept()
            with client:
                try:
                    send(client, float(first_ut))
                except OSError:
                    pass


def send(client, first_ut):
    client.sendall(b"\x00\x41\r\n")  # a client joins in the middle of a frame
    while True:
        numbers = []
        for chip in range(5):
            numbers += [25.0, first_ut + chip, -first_ut, 0.5 * chip]
        client.sendall(struct.pack("<20f", *numbers) + b"\r\n")
        time.sleep(1.0 / HZ)


main(*sys.argv[1:])
