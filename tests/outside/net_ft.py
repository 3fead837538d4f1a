"""The PyPI packages NetFT and pynetft read a Net F/T at an address, and print the mean force along each axis, N."""

import sys

RECORDS = 50
COUNTS = 1e6


def by_netft(host):
    import NetFT

    sensor = NetFT.Sensor(host)  # at port 49152, which it has fixed
    sensor.getMeasurements(RECORDS)
    records = [sensor.receive()[:3] for _ in range(RECORDS)]
    single = sensor.getForce()
    sensor.startStreaming(handler=False)
    records += [sensor.receive()[:3] for _ in range(RECORDS)]
    sensor.stopStreaming()
    assert all(abs(force) < 1e6 for force in single), single
    return [[count / COUNTS for count in record] for record in records]


def by_pynetft(host, port):
    from pynetft import Calibration, CalibrationSource, Client, ClientState, Config, ForceUnit, TorqueUnit

    calibration = Calibration(COUNTS, COUNTS, ForceUnit.NEWTON, TorqueUnit.NEWTON_MILLIMETER)
    config = Config(sensor_host=host, rdt_port=port, calibration_override=calibration, receive_timeout=0.5)
    with Client(config, queue_size=1000) as client:
        samples = client.samples(timeout=5.0)
        samples = [next(samples) for _ in range(2 * RECORDS)]
        health = client.health()
    assert health.state is ClientState.STREAMING and health.sensor_configuration.source is CalibrationSource.OVERRIDE
    counts = (health.lost_count, health.malformed_count, health.out_of_order_count, health.ft_backward_count)
    assert counts == (0, 0, 0, 0) and health.device_error_count == 0, health
    assert all(sample.status == 0 for sample in samples)
    # the queue of a busy client may lose some: the order stays
    sequence = [sample.rdt_sequence for sample in samples]
    assert all(before < after for before, after in zip(sequence, sequence[1:]))
    return [sample.force for sample in samples]


def main(package, host, port):
    records = by_netft(host) if package == "NetFT" else by_pynetft(host, int(port))
    means = [sum(axis) / len(records) for axis in zip(*records)]
    print(" ".join(f"{mean:.4f}" for mean in means))


main(*sys.argv[1:])
