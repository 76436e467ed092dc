"""A cluster of Apache Spark on this computer: a master and workers, each a process of its own."""

import os
import pathlib
import signal
import socket
import subprocess
import sys
import time

import pyspark

#: A loaded computer is slow.
PATIENCE_S = 180

HOST = "127.0.0.1"
HOME = pathlib.Path(pyspark.__file__).parent


def free_port():
    with socket.socket() as it:
        it.bind((HOST, 0))
        return it.getsockname()[1]


def until(what, is_true):
    """Waits until something is true."""
    end = time.monotonic() + PATIENCE_S
    while not is_true():
        assert time.monotonic() < end, f"{what}: not within {PATIENCE_S} s"
        time.sleep(0.05)


def answers(port):
    with socket.socket() as it:
        return it.connect_ex((HOST, port)) == 0


class Cluster:
    """A master; workers come and go. All end with it."""

    def __init__(self, folder):
        self.folder = pathlib.Path(folder).absolute()
        self.folder.mkdir()
        self.processes = []
        self.workers = []

    def __enter__(self):
        try:
            port = free_port()
            self.url = f"spark://{HOST}:{port}"
            names = ["--host", HOST, "--port", str(port), "--webui-port", str(free_port())]
            self._start("master", "org.apache.spark.deploy.master.Master", names)
            until("the master", lambda: answers(port))
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        for process in reversed(self.processes):
            kill(process)

    def _start(self, name, java_class, arguments, prefix=()):
        environment = {
            **os.environ,
            "SPARK_HOME": str(HOME),
            "SPARK_LOCAL_IP": HOST,
            "SPARK_DAEMON_MEMORY": "256m",
            "SPARK_WORKER_DIR": str(self.folder / f"{name}.work"),
            "SPARK_LOCAL_DIRS": str(self.folder / f"{name}.local"),
            "PYSPARK_PYTHON": sys.executable,
        }
        log = open(self.folder / f"{name}.log", "wb")
        process = subprocess.Popen(
            [*prefix, HOME / "bin/spark-class", java_class, *arguments],
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            # So that it ends with all that it has started.
            start_new_session=True,
        )
        self.processes.append(process)
        return process

    def add_worker(self):
        """One more worker: a computer with one core, which none of its threads can leave."""
        number = len(self.workers)
        name = f"worker{number + 1}"
        cores = sorted(os.sched_getaffinity(0))
        pinned = ["taskset", "--cpu-list", str(cores[number % len(cores)])]
        names = ["--host", HOST, "--webui-port", str(free_port()), "--cores", "1", "--memory", "1g"]
        java_class = "org.apache.spark.deploy.worker.Worker"
        self.workers.append(self._start(name, java_class, [*names, self.url], prefix=pinned))

    def kill_worker(self):
        """Ends the last worker, and its executor, at once."""
        kill(self.workers.pop())

    def settings(self):
        """Those of a session: one executor in each worker, all on this computer."""
        return {
            "spark.ui.enabled": "false",
            "spark.ui.showConsoleProgress": "false",
            "spark.driver.host": HOST,
            "spark.driver.bindAddress": HOST,
            "spark.driver.memory": "1g",
            "spark.executor.memory": "512m",
            "spark.executor.cores": "1",
            "spark.local.dir": str(self.folder / "driver.local"),
            "spark.sql.warehouse.dir": str(self.folder / "warehouse"),
            "spark.executorEnv.PYTHONPATH": os.environ["PYTHONPATH"],
            # As many tasks as there are folders would be too many for two cores.
            "spark.sql.sources.parallelPartitionDiscovery.parallelism": "4",
        }

    def session(self):
        """A session with this cluster."""
        os.environ["PYSPARK_PYTHON"] = sys.executable
        os.environ["SPARK_LOCAL_IP"] = HOST
        builder = pyspark.sql.SparkSession.builder.master(self.url).appName("plumbline")
        for name, value in self.settings().items():
            builder = builder.config(name, value)
        session = builder.getOrCreate()
        session.sparkContext.setLogLevel("ERROR")
        return session


def executors(session):
    # The driver is one of them.
    return session.sparkContext._jsc.sc().getExecutorMemoryStatus().size() - 1


def kill(process):
    # Also what it has started, which may live on without it.
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    process.wait()
