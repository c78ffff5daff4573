"""cflib as the client of an emulated Crazyflie: connects, reads tables, parameters and log data, arms, flies, and falls silent.

Run by tests/crazyflie.rs, with a Python interpreter that has requirements.txt installed: crtp_client.py HOST:PORT PROTOCOL.
"""

import sys
import threading
import time
import warnings

import cflib.crtp
from cflib.crazyflie import Crazyflie
from cflib.crazyflie.log import LogConfig
from cflib.crazyflie.syncCrazyflie import SyncCrazyflie

warnings.simplefilter("ignore")
SUPERVISOR_ARMED, SUPERVISOR_FLYING, SUPERVISOR_LOCKED = 1 << 1, 1 << 4, 1 << 6


class Watch:
    """The newest log data, and waiting for them."""

    def __init__(self, crazyflie):
        self.data, self.news = {}, threading.Condition()
        config = LogConfig("state", 50)
        for name in ("pm.vbat", "supervisor.info", "stateEstimate.roll", "stateEstimate.pitch", "stateEstimate.z"):
            config.add_variable(name)
        config.data_received_cb.add_callback(self.take)
        crazyflie.log.add_config(config)
        config.start()

    def take(self, timestamp, data, config):
        with self.news:
            self.data = data
            self.news.notify_all()

    def until(self, what, holds, act=lambda: None):
        """Waits, at most 20 s, and repeats `act` meanwhile, as a host repeats its set-points."""
        deadline = time.monotonic() + 20
        with self.news:
            while not (self.data and holds(self.data)):
                assert time.monotonic() < deadline, f"{what}: {self.data}"
                act()
                self.news.wait(0.01)


def fly(crazyflie, watch):
    commander = crazyflie.commander
    has = lambda bit: lambda data: data["supervisor.info"] & bit
    crazyflie.supervisor.send_arming_request(True)
    watch.until("armed", has(SUPERVISOR_ARMED), lambda: commander.send_setpoint(0, 0, 0, 0))
    watch.until("flying", has(SUPERVISOR_FLYING), lambda: commander.send_setpoint(0, 0, 0, 45000))
    # Signs as cflib has them: roll to the right is positive, and pitch forward, which the vehicle reports as negative.
    watch.until("rolled", lambda d: d["stateEstimate.roll"] > 4, lambda: commander.send_setpoint(8, 0, 0, 40000))
    watch.until("pitched", lambda d: d["stateEstimate.pitch"] < -4, lambda: commander.send_setpoint(0, 8, 0, 40000))
    # Silence: level after half a second, locked after two.
    watch.until("level", lambda d: abs(d["stateEstimate.roll"]) < 1 and abs(d["stateEstimate.pitch"]) < 1)
    watch.until("locked", has(SUPERVISOR_LOCKED))


def main(address, protocol):
    cflib.crtp.init_drivers()
    with SyncCrazyflie(f"udp://{address}", cf=Crazyflie()) as sync:
        crazyflie = sync.cf
        assert crazyflie.platform.get_protocol_version() == protocol
        sync.wait_for_params()
        assert float(crazyflie.param.get_value("locSrv.extPosStdDev")) == 0.009999999776482582
        crazyflie.param.set_value("flightmode.stabModeYaw", 0)
        watch = Watch(crazyflie)
        watch.until("a battery", lambda data: 3.0 < data["pm.vbat"] <= 4.2)
        if protocol >= 12:
            assert crazyflie.supervisor.can_be_armed and not crazyflie.supervisor.is_armed
        crazyflie.loc.send_extpose([0.5, 0.0, 0.25], [0.0, 0.0, 0.0, 1.0])
        watch.until("the pose", lambda data: abs(data["stateEstimate.z"] - 0.25) < 1e-3)
        fly(crazyflie, watch)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
