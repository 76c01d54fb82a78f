"""`voltwall drill`: bad days without names, for the crew at a running service, or for the product by itself."""

import argparse
import json
import secrets
import sys
import tempfile
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from app.analysis.drill.days import CHOICES, Day, draw_days
from app.analysis.drill.product import answer_of_cause, answer_of_events
from app.analysis.drill.score import Answer, most_points, points, total
from app.analysis.root_cause.cause import Cause
from app.analysis.root_cause.from_session import causes_of
from app.battery.shape import CELLS_PER_PACK, N_PACKS
from app.commands.console.config_service import ConfigService
from app.commands.guided.play import Played, play
from app.errors import ConfigError
from app.live.pipeline_factory import PipelineFactory
from app.sessions.reading.reader import SessionFile

SEEDS = 1_000_000


def run(args: argparse.Namespace) -> int:
    """Play, ask, score.

    Raises:
        AppError: no service answers, or a setting cannot be used.
    """
    if args.seed is not None and not 0 <= args.seed <= SEEDS:
        raise ConfigError("--seed", args.seed, f"0..{SEEDS}")
    seed = secrets.randbelow(SEEDS) if args.seed is None else args.seed
    return _product(args, seed) if args.product else _crew(args, seed)


# --- the product by itself


def _product(args: argparse.Namespace, seed: int) -> int:
    factory = PipelineFactory("fused", args.cell)
    results = []
    with tempfile.TemporaryDirectory(prefix="voltwall-drill-") as folder:
        for day in draw_days(seed, args.days):
            result = _result(day, play(day, Path(folder), args.speed, factory))
            results.append(result)
            if not args.json:
                _print_day(result)
    got, most = total([(result["points"], result["most"]) for result in results])
    if args.json:
        json.dump({"seed": seed, "points": got, "most": most, "days": results}, sys.stdout, indent=2)
        print()
    else:
        print(f"seed {seed}: the product has {got} of {most} points")
    return 1 if args.share is not None and got < args.share * most else 0


def _result(day: Day, played: Played) -> dict[str, Any]:
    timed_events = played.after(day.at_s)
    causes = [] if played.session is None else _causes(played.session)
    meant = [answer_of_cause(cause.code, cause.cell, cause.pack) for cause in causes]
    events = answer_of_events((event.code, event.cell) for _, event in timed_events)
    answer = next((each for each in meant if each is not None), events)
    return {
        "number": day.number,
        "fault": day.fault,
        "pack": day.pack,
        "cell": day.cell,
        "value": day.value,
        "answer": None if answer is None else asdict(answer),
        "points": points(day, answer),
        "most": most_points(day),
        "visible_s": round(min((t_s for t_s, _ in timed_events), default=0.0) - day.at_s, 1) if timed_events else None,
        "said": [*(cause.message for cause in causes), *(event.text for _, event in timed_events)][:8],
    }


def _causes(path: Path) -> list[Cause]:
    with SessionFile(path) as session:
        return causes_of(session)


def _print_day(result: dict[str, Any]) -> None:
    value = "" if result["value"] is None else f" ({result['value']:g})"
    print(f"day {result['number']}: {_place(result)}{value}; {result['points']} of {result['most']} points")
    answer = result["answer"]
    print(f"  answered: {'nothing' if answer is None else _place(answer)}")
    visible = result["visible_s"]
    print(f"  visible {'never' if visible is None else f'after {visible:.1f} s'}; the product said:")
    for text in result["said"] or ["nothing"]:
        print(f"    {text}")
    sys.stdout.flush()


def _place(what: dict[str, Any]) -> str:
    parts = [what["fault"], *(f"{name} {what[name]}" for name in ("pack", "cell") if what[name] is not None)]
    return ", ".join(parts)


# --- the crew, at a running service


def _crew(args: argparse.Namespace, seed: int) -> int:
    service = ConfigService(args.url, "simulator/drill", trust=args.trust)
    state = service.send("", "POST", {"seed": seed, "days": args.days})
    names = list(CHOICES)
    if not args.json:
        print(f"Look at {args.url}; something goes wrong within a minute of each day. What failed?")
    try:
        while state["is_on"]:
            answer = _ask(state, names)
            state = service.send("/answer", "POST", asdict(answer))
            if not args.json:
                _print_debrief(state["results"][-1])
    except (KeyboardInterrupt, EOFError):
        service.ask(method="DELETE")
        raise KeyboardInterrupt from None
    got, most, seed = state["points"], state["most"], state["seed"]
    if args.json:
        json.dump(state, sys.stdout, indent=2)
        print()
    else:
        product = sum(result["product_points"] for result in state["results"])
        print(f"seed {seed}: you have {got} of {most} points, the product {product}")
    return 0


def _ask(state: dict[str, Any], names: list[str]) -> Answer:
    print(f"\nDay {state['day']} of {state['days']}, {time.strftime('%H:%M:%S')}", file=sys.stderr)
    for number, name in enumerate(names, 1):
        print(f"  {number:2} {name:24}", end="\n" if number % 3 == 0 else "", file=sys.stderr)
    while True:
        fault = _choice(input(f"\nWhat failed, 1 to {len(names)} or its name: "), names)
        if fault is not None:
            break
    target = CHOICES[fault]
    if target == "none":
        return Answer(fault)
    pack = _number("Which pack", N_PACKS)
    return Answer(fault, pack, _number("Which cell", CELLS_PER_PACK) if target == "cell" else None)


def _choice(text: str, names: list[str]) -> str | None:
    text = text.strip()
    if text.isdecimal() and 1 <= int(text) <= len(names):
        return names[int(text) - 1]
    return text if text in names else None


def _number(question: str, most: int) -> int:
    while True:
        text = input(f"{question}, 1 to {most}: ").strip()
        if text.isdecimal() and 1 <= int(text) <= most:
            return int(text)


def _print_debrief(result: dict[str, Any]) -> None:
    _print_day(result)
    print(f"  you took {result['taken_s']:.0f} s; the product would have {result['product_points']} points")
