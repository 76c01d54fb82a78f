"""`voltwall completion`: what a shell runs at its start to complete our commands and options."""

import argparse

from app.commands.arguments.work import Work

SHELLS = ("bash", "zsh", "fish", "powershell")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.set_defaults(do=Work("console.completion.run"))
    parser.description = "Print what lets a shell complete the commands and options of voltwall with Tab."
    parser.epilog = (
        'bash        eval "$(voltwall completion bash)" in ~/.bashrc\n'
        'zsh         eval "$(voltwall completion zsh)" in ~/.zshrc, after compinit\n'
        "fish        voltwall completion fish > ~/.config/fish/completions/voltwall.fish\n"
        "PowerShell  voltwall completion powershell | Out-String | Invoke-Expression, in $PROFILE"
    )
    parser.add_argument("shell", choices=SHELLS, metavar="SHELL", help=", ".join(SHELLS))
