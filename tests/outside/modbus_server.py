"""pymodbus serves a load cell that our drivers are to read: over TCP, or over a pseudo-terminal (rtu).

The force is scripted: 0.250 N, and on top of it -2 to 2 mN in turn, from one read to the next. Maps:
  transmitter   register 80: mN as i32, 8: three decimals
  t7            register 26: N as f32; 60000 and 55100 say that it is a LabJack T7
  swapped       register 26: N as f32, low word first
Prints where it is, and serves until it is ended."""

import asyncio
import os
import struct
import sys
import tty
from itertools import cycle

from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

forces_n = cycle([0.248, 0.251, 0.250, 0.252, 0.249])


def words(form, value):
    return list(struct.unpack(">2H", struct.pack(form, value)))


def transmitter():
    return {8: [3], 80: words(">i", round(1000 * next(forces_n)))}


def t7():
    return {26: words(">f", next(forces_n)), 55100: [0x0011, 0x2233], 60000: words(">f", 7.0)}


def swapped():
    return {26: words(">f", next(forces_n))[::-1]}


def device(registers):
    """A device of these registers; those of the force are new at each read of them."""

    async def look(function, start, address, count, current, values):
        for first, fresh in registers().items():
            # a request for other registers is no look at the force
            if values is None and address <= first < address + count:
                current[first - start : first - start + len(fresh)] = fresh

    data = [SimData(at, values=fresh, datatype=DataType.REGISTERS) for at, fresh in registers().items()]
    return SimDevice(1, simdata=data, action=look)


def pump(source, sink):
    """Carries bytes from one terminal to another; pymodbus opens its serial port by name, and keeps it to itself."""
    asyncio.get_running_loop().add_reader(source, lambda: os.write(sink, os.read(source, 256)))


async def main(link, map_name):
    served = device({"transmitter": transmitter, "t7": t7, "swapped": swapped}[map_name])
    if link == "tcp":
        server = ModbusTcpServer(served, address=("127.0.0.1", 0))
        await server.serve_forever(background=True)
        print("127.0.0.1:%d" % server.transport.sockets[0].getsockname()[1], flush=True)
    else:
        (inner, port), (outer, offered) = os.openpty(), os.openpty()
        for terminal in inner, port, outer, offered:
            tty.setraw(terminal)
        server = ModbusSerialServer(served, port=os.ttyname(port), baudrate=115200)
        await server.serve_forever(background=True)
        pump(inner, outer)
        pump(outer, inner)
        print(os.ttyname(offered), flush=True)
    await asyncio.Event().wait()


asyncio.run(main(*sys.argv[1:]))
