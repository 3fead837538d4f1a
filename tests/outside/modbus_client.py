"""pymodbus asks a device of ours: a LabJack T7 over TCP, or one of four transmitters over a serial line."""

import sys

from pymodbus.client import ModbusSerialClient, ModbusTcpClient

FUNCTION, ADDRESS, VALUE = 1, 2, 3


class Device:
    def __init__(self, client, unit=1):
        assert client.connect()
        self.client, self.unit = client, unit
        self.types = client.DATATYPE

    def read(self, address, count):
        """Registers, the same whether they are called holding or input registers."""
        answer = self.client.read_holding_registers(address, count=count, device_id=self.unit)
        assert not answer.isError(), answer
        assert len(answer.registers) == count
        assert not self.client.read_input_registers(address, count=count, device_id=self.unit).isError()
        return answer.registers

    def number(self, address, kind, order="big"):
        return self.client.convert_from_registers(self.read(address, kind.value[1]), kind, order)

    def write(self, address, *words):
        if len(words) == 1:
            answer = self.client.write_register(address, words[0], device_id=self.unit)
        else:
            answer = self.client.write_registers(address, list(words), device_id=self.unit)
        return answer.exception_code if answer.isError() else None

    def refuses(self, code, answer):
        assert answer.isError() and answer.exception_code == code, (code, answer)

    def refuses_as_all_do(self, last):
        """Coils, an address beyond the last and too many registers are refused by any of these devices."""
        client, unit = self.client, self.unit
        self.refuses(FUNCTION, client.read_coils(0, count=1, device_id=unit))
        self.refuses(FUNCTION, client.read_exception_status(device_id=unit))
        self.refuses(ADDRESS, client.read_holding_registers(last + 1, count=2, device_id=unit))
        assert self.write(last + 1, 0, 0) == ADDRESS


def t7(host, port):
    device = Device(ModbusTcpClient(host, port=int(port)))
    floats, longs = device.types.FLOAT32, device.types.UINT32
    assert device.number(60000, floats) == 7.0
    assert device.number(55100, longs) == 0x00112233
    assert device.number(55100, longs, "little") == 0x22330011
    # PRODUCT_ID is 40E00000; with its words the other way round it is next to nothing
    assert device.number(60000, floats, "little") < 1e-30

    # all inputs at once, in air
    volts = device.client.convert_from_registers(device.read(0, 28), floats, "big")
    assert len(volts) == 14 and max(map(abs, volts)) < 0.1, volts
    assert volts[9:] == [0.0] * 5, volts

    # a float out and back, its words in the device's order
    words = device.client.convert_to_registers(2.5, floats, "big")
    assert words == [0x4020, 0] and device.write(1000, *words) is None
    assert device.number(1000, floats) == 2.5
    words = device.client.convert_to_registers(2.5, floats, "little")
    assert words == [0, 0x4020] and device.write(1002, *words) is None
    assert device.number(1002, floats) < 1e-30

    device.refuses_as_all_do(last=61521)
    assert device.write(1000, 1) == VALUE, "half a float"
    assert device.number(55000, device.types.UINT16) == 2315
    device.refuses(VALUE, device.client.read_holding_registers(0, count=3, device_id=1))
    for unit in (0, 17, 247, 255):
        assert Device(device.client, unit).number(60000, floats) == 7.0
    return max(map(abs, volts))


def serial(path):
    return Device(ModbusSerialClient(path, baudrate=9600, timeout=2, retries=0))


def rs485(path):
    device = serial(path)
    long = device.types.INT32
    registers = device.read(0, 100)
    assert registers[8] & 7 == 3, "three decimals"
    # the low word first is a value no cell has
    gross_n = device.number(80, long) / 1000
    assert abs(device.number(80, long, "little")) > 1000 or gross_n == 0.0
    assert abs(gross_n) < 0.1, gross_n
    assert device.write(94, 1) is None and abs(device.number(80, long)) <= 50, "zeroed"
    assert device.write(84, 0, 500) is None
    assert device.number(82, long) == device.number(80, long) - 500 or abs(device.number(82, long) + 500) <= 50
    assert device.write(94, 2) == VALUE
    device.refuses_as_all_do(last=99)
    return gross_n


def tlb(path):
    device = serial(path)
    long = device.types.UINT32
    registers = device.read(0, 32)
    assert registers[13] == 3
    status, gross_n = registers[6], device.number(7, long) / 1000
    assert status & 0b111111 == 0 and gross_n < 0.1, (status, gross_n)
    assert device.write(5, 8) is None and device.number(7, long) <= 50, "zeroed"
    assert device.write(5, 7) is None and device.read(6, 1)[0] & 1 << 10, "net is shown"
    assert device.write(5, 1000) == VALUE
    device.refuses(VALUE, device.client.read_holding_registers(0, count=33, device_id=1))
    device.refuses_as_all_do(last=79)
    return gross_n


def zsg(path, status=65, command=66, last=69):
    device = serial(path)
    floats = device.types.FLOAT32
    registers = device.read(0, last + 1)
    net_n = device.client.convert_from_registers(registers[63:65], floats, "big")
    assert abs(net_n) < 0.1, net_n
    swapped = device.client.convert_from_registers(registers[63:65], floats, "little")
    assert swapped != net_n or net_n == 0.0
    assert registers[status] & 0b10010 == 0b10000, "within its scale, and stable"
    assert device.write(command, 49914) is None and abs(device.number(63, floats)) < 0.05, "tared"
    assert device.write(command, 1) == VALUE
    device.refuses_as_all_do(last)
    return net_n


def zsg2(path):
    return zsg(path, status=77, command=79, last=99)


print(f"{ {'t7': t7, 'rs485': rs485, 'tlb': tlb, 'zsg': zsg, 'zsg2': zsg2}[sys.argv[1]](*sys.argv[2:]) :.4f}")
