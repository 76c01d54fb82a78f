"""`voltwall completion`: what a shell runs at its start to complete our commands and options."""

import argparse

from app.errors import ExtraMissing

SHELLS = ("bash", "zsh", "fish", "powershell")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the argument: the shell."""
    parser.set_defaults(run=run)
    parser.description = "Print the Tab completion of voltwall's commands and options for a shell."
    parser.epilog = (
        'bash        eval "$(voltwall completion bash)" in ~/.bashrc\n'
        'zsh         eval "$(voltwall completion zsh)" in ~/.zshrc, after compinit\n'
        "fish        voltwall completion fish > ~/.config/fish/completions/voltwall.fish\n"
        "PowerShell  voltwall completion powershell | Out-String | Invoke-Expression, in $PROFILE"
    )
    parser.add_argument("shell", choices=SHELLS, metavar="SHELL", help=", ".join(SHELLS))


def run(args: argparse.Namespace) -> int:
    """Print the code of a shell.

    Raises:
        ExtraMissing: argcomplete is not installed.
    """
    try:
        from argcomplete.shell_integration import shellcode
    except ImportError as error:
        raise ExtraMissing("completion", "argcomplete", "completion") from error
    print(shellcode(["voltwall"], shell=args.shell), end="")
    return 0
