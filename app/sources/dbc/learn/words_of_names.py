"""Names of signals as words and numbers: `BMS_SegACell03_mV` is bms seg a cell 3 mv. What the words suggest."""

import re
from functools import cache


def name_set(text: str) -> frozenset[str]:
    """Return the words of a text."""
    return frozenset(text.split())


_TOKEN = re.compile(
    r"So[CHE](?![a-z])|AIR(?![a-z]{2})|m[VA](?![A-Za-z])|[A-ZÄÖÜÆØÅ]+(?![a-zäöüßæøå])|[A-ZÄÖÜÆØÅ]?[a-zäöüßæøå]+|\d+|[^\W\d_]+"
)  # mV, mA, SoC and the AIR of AIRp stay whole
VOLTAGE = name_set(
    "v u mv volt volts voltage voltages vcell cellv cv cvolt vc spannung spannungen spenning spänning spænding "
    "tension tensions tensione tensioni tensao tensão voltaje napiecie napětí napeti napetost spanning gerilim "
    "jannite jännite feszultseg uc uz zv vz vcel potential"
)
CELL = name_set(
    "cell cells zelle zellen zell celle cella celler cellule cellules celda celdas celula celulas célula cv vcell "
    "cellv vc ct tcell cvolt brick tap mono block batt cel cellen ogniwo ogniwa clanek clanku celica hucre kenno "
    "cella vcel zv ze"
)
TEMPERATURE = name_set(
    "t temp temps temperature temperatures temperatur temperaturen temperatura temperaturas temperaturer therm "
    "thermistor thermistors ntc tmp tcell ct tc degc tz"
)
NOT_A_CELL = name_set(
    "min max minimum maximum avg average mean median mittel lowest highest low high lo hi delta diff spread "
    "limit limits lim thresh threshold thrs target set setpoint setting request req cmd command over under ov "
    "uv ot ut ocv open sum total bal balance balancing shunt discharge fault faults error errors err flag "
    "flags status state valid invalid count counter cnt crc checksum chk alive rolling version resist "
    "resistance res ir ohm soc soh soe dod capacity energy power current motor phase inverter inv mc mcu lv "
    "glv lvs pedal apps throttle brake steering coolant water oil fan pump radiator charger chg precharge "
    "dcdc ref reference vref variance stddev std imbalance hysteresis calibration calib trip warn warning "
    "alarm supply id index idx num number adjusted corrected compensated filtered pcb ambient"
)
SEGMENT = name_set(
    "seg segs segment segments segm module modul mod mods stack slave ic ics chip board bank bmb bmu cmu csc "
    "cmb pack string ltc afe adbms unit section box brd tray node daughter device dev sub submodule vtm bms "
    "satellite peripheral perif"
)
GROUP = name_set(
    "group grp grps page mux multiplexer multiplexor start first base frame part row block offset set packet "
    "selector from"
)
FIRST = name_set("start first base offset from")
NUMBER = name_set(
    "id idx ids index num number nr no nbr n cell cells sensor thermistor therm channel ch pos position mux ntc temp"
)
NO_NUMBER = name_set(
    "counter cnt crc checksum chk alive rolling version state status flags error fault count total max min "
    "highest lowest heartbeat seq sequence"
)
NO_QUANTITY = name_set("crc checksum chk counter cnt alive rolling heartbeat seq sequence reserved unused blank")
CURRENT = name_set(
    "current currents curr cur strom strøm ström stroom corrente corriente courant prad proud tok akim virta i amp "
    "amps amperage ipack ibat ibatt"
)
PACK = name_set(
    "pack batt battery bat batterie batteria bateria batterij batteri akku accumulator accumulatore accu acc pacco "
    "hv hvb ts tractive bms ams bus dc link ivt shunt string stack total totale sum gesamt summe instant inst result"
)
CHARGER = name_set("charger chg obc elcon brusa nlg onboard")
NOT_THE_PACK = name_set(
    "limit lim limits max min maximum minimum avg average abs absolute motor phase iq id iqs ids inverter inv "
    "mc charger chg obc request req target cmd command set setpoint ccl dcl lv glv lvs fan fans pump pumps "
    "coolant cooling radiator heater fault error adc raw warning threshold thresh high low over under trip peak "
    "allowed available capability dcdc brake steering fuse rms ref reference cell cells counter cnt state status "
    "valid temp temperature power energy kw wh ah offset regen front rear left right"
)


SOC = name_set("soc ladezustand ladestand")
_JOINED = VOLTAGE | CELL | TEMPERATURE | CURRENT | PACK | SEGMENT
_LEAST_PART = 3  # letters of a word that another is joined to


@cache
def tokens(name: str) -> tuple[str, ...]:
    """Return the words and numbers of a name, in lower case; `Zellspannung` and `cellvoltage` are two words."""
    return tuple(part for token in _TOKEN.findall(name) for part in _parted(token.lower()))


def _parted(token: str) -> tuple[str, ...]:
    for at in range(_LEAST_PART, len(token) - _LEAST_PART + 1):
        if token[:at] in _JOINED and token[at:] in _JOINED:
            return token[:at], token[at:]
    return (token,)


def words(name: str) -> frozenset[str]:
    """Return the words of a name without its numbers."""
    return frozenset(token for token in tokens(name) if not token.isdigit())


def skeleton(name: str) -> str:
    """Return a name with `#` for each number."""
    return re.sub(r"\d+", "#", name)


def numbers(name: str) -> tuple[int, ...]:
    """Return the numbers of a name from left to right."""
    return tuple(int(each) for each in re.findall(r"\d+", name))
