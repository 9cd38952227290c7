"""Commands that each verb's help ends with; a test parses every one."""

EXAMPLES: dict[str, tuple[str, ...]] = {
    "demo": ("gonio demo", "gonio demo chapter -o chapter.html --set theta_i=60"),
    "materials": ("gonio materials", "gonio materials gold", "gonio materials --json"),
    "models": ("gonio models", "gonio models ggx --picture ggx.png"),
    "eval": (
        "gonio eval 'ggx(alpha=0.2)' --theta-i 30 --theta-o 0:80:10",
        "gonio eval gold --theta-i 0,30,60 --theta-o -80:80:5 -o gold.csv",
        "gonio eval T.h5 --theta-i 45 --theta-o 45 --delta-phi 0:180:15",
        "gonio eval gold --directions - < directions.csv > values.csv",
    ),
    "measure": (
        "gonio measure gold --dry-run --instrument lab.toml",
        "gonio measure gold -o gold.h5 --photons 1e7 --detector-half-angle 0.1",
        "gonio measure gold --adaptive --target 1% -o gold.h5",
    ),
    "plan": (
        "gonio plan gold --budget 2h -o path.csv",
        "gonio plan gold.fit.toml --target 0.5% --for albedo,ggx.alpha -o path.csv",
    ),
    "info": ("gonio info T.h5", "gonio info *.bsdf", "gonio info T.h5 --json | jq .channels"),
    "fit": (
        "gonio fit T.h5 -m 'lambert + ggx(eta=?)' -o T.fit.toml",
        "gonio fit T.h5 -v",
        "gonio fit tables/ -m 'lambert + ggx(eta=1.5)' -o fits/",
    ),
    "check": (
        "gonio check gold",
        "gonio check T.h5 --model auto",
        "gonio check *.h5",
        "gonio check T.h5 -q && echo pass",
    ),
    "quantities": (
        "gonio quantities gold",
        "gonio quantities T.h5 --budget --uncertainty 'gain=0.5 %, tilt=0.05 deg'",
    ),
    "campaign": (
        "gonio campaign recipe.toml -o runs/ --dry-run",
        "gonio campaign recipe.toml -o runs/ --workers 8",
        "gonio campaign recipe.toml -o runs/ --scheduler tcp://cluster:8786",
        "gonio campaign runs/                         # catalogue, page anew",
    ),
    "chart": ("gonio chart hemisphere -o charts", "gonio chart -o charts --quick --tolerance 1e-3"),
    "stress": ("gonio stress ggx", "gonio stress --quick -o atlas"),
    "reduce": ("gonio reduce T.h5 --scene low_sun_car -o small.h5",),
    "report": (
        "gonio report T.h5 --fit T.fit.toml -o T.html",
        "gonio report *.bsdf -o all.html --figures figures",
    ),
    "convert": (
        "gonio convert plastic.fit.toml plastic.xml --to mitsuba",
        "gonio convert T.h5 plastic.gltf -m 'lambert + ggx(f0=?)' --tolerance 10%",
        "gonio convert gold gold.bsdf",
        "gonio convert T.h5 - | head",
    ),
    "completion": (
        'eval "$(gonio completion bash)"          # a line for ~/.bashrc',
        'eval "$(gonio completion zsh)"           # a line for ~/.zshrc, after compinit',
        "gonio completion fish > ~/.config/fish/completions/gonio.fish",
    ),
}  # fmt: skip
