cd /tmp/r7/next; export PYTHONSAFEPATH=1 PYTHONPATH=/tmp/r7/next; exec /work/wt/r7/.venv/bin/python -m "$@"
