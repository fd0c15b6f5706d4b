"""QGIS Processing script: an orthoimage, a surface model and a COPC point cloud of scans, by the program surfel.

Install: Processing toolbox > Scripts > Add Script to Toolbox, or copy this file into processing/scripts of the QGIS
profile. The program `surfel` is searched on the path, or is named by the environment variable SURFEL_PROGRAM.
Headless:

    qgis_process run script:surfelsurvey -- INPUT=tile.laz GSD=0.1 ORTHO=rgb.tif DSM=dsm.tif COPC=all.copc.laz

Debian's wrapper qgis_process of QGIS 3.22 passes an option that it doesn't know: call qgis_process.bin there.
"""

import os
import shlex
import shutil
import subprocess

from qgis.core import (
    QgsProcessing,
    QgsProcessingAlgorithm,
    QgsProcessingException,
    QgsProcessingParameterFileDestination,
    QgsProcessingParameterMultipleLayers,
    QgsProcessingParameterNumber,
    QgsProcessingParameterRasterDestination,
    QgsProcessingParameterString,
)


class SurfelSurvey(QgsProcessingAlgorithm):
    INPUT, GSD, COLOR_BY, OPTIONS = "INPUT", "GSD", "COLOR_BY", "OPTIONS"
    ORTHO, DSM, COPC = "ORTHO", "DSM", "COPC"

    def name(self):
        return "surfelsurvey"

    def displayName(self):
        return "Orthoimage, surface model and COPC of scans"

    def group(self):
        return "Surfel"

    def groupId(self):
        return "surfel"

    def shortHelpString(self):
        return (
            "Draws scans (LAS, LAZ, COPC, E57, PLY and others) from above as smooth surfaces. The orthoimage and the "
            "heights of the surface are cloud-optimised GeoTIFFs without holes between points. COPC is the point cloud "
            "itself with levels of detail. All outputs are optional."
        )

    def createInstance(self):
        return SurfelSurvey()

    def initAlgorithm(self, config=None):
        files = QgsProcessingParameterMultipleLayers(self.INPUT, "Scans of one area", QgsProcessing.TypeFile)
        files.setMinimumNumberInputs(1)
        self.addParameter(files)
        self.addParameter(
            QgsProcessingParameterNumber(
                self.GSD, "Side of a pixel, in units of the map", QgsProcessingParameterNumber.Double, 0.5, minValue=1e-6
            )
        )
        self.addParameter(
            QgsProcessingParameterString(
                self.COLOR_BY, "Colour by an attribute, such as height or classification", "", optional=True
            )
        )
        self.addParameter(
            QgsProcessingParameterString(self.OPTIONS, "Further options of surfel ortho", "", optional=True)
        )
        self.addParameter(QgsProcessingParameterRasterDestination(self.ORTHO, "Orthoimage", optional=True))
        self.addParameter(QgsProcessingParameterRasterDestination(self.DSM, "Surface model", optional=True))
        copc = QgsProcessingParameterFileDestination(
            self.COPC, "COPC point cloud", "COPC (*.copc.laz)", optional=True, createByDefault=False
        )
        self.addParameter(copc)

    def processAlgorithm(self, parameters, context, feedback):
        files = self.parameterAsFileList(parameters, self.INPUT, context)
        ortho = self.parameterAsOutputLayer(parameters, self.ORTHO, context)
        dsm = self.parameterAsOutputLayer(parameters, self.DSM, context)
        copc = self.parameterAsFileOutput(parameters, self.COPC, context)
        if not (ortho or dsm or copc):
            raise QgsProcessingException("No output was chosen: expected an orthoimage, a surface model or COPC.")
        results = {}
        if ortho or dsm:
            gsd = self.parameterAsDouble(parameters, self.GSD, context)
            command = ["ortho", *files, "--gsd", repr(gsd), "--force"]
            command += ["-o", ortho] if ortho else []
            command += ["--dsm", dsm] if dsm else []
            color_by = self.parameterAsString(parameters, self.COLOR_BY, context)
            command += ["--color-by", color_by] if color_by else []
            command += shlex.split(self.parameterAsString(parameters, self.OPTIONS, context))
            run(command, feedback)
            results.update({self.ORTHO: ortho} if ortho else {})
            results.update({self.DSM: dsm} if dsm else {})
        if copc:
            copc = copc if copc.endswith(".copc.laz") else copc + ".copc.laz"
            run(["convert", *files, "-o", copc, "--force"], feedback)
            results[self.COPC] = copc
        return results


def program():
    """Returns the path of the program."""
    found = shutil.which(os.environ.get("SURFEL_PROGRAM", "surfel"))
    if found is None:
        raise QgsProcessingException(
            "The program surfel wasn't found on the path. Install it (cargo install surfel-cli, or the Debian package), "
            "or name it by the environment variable SURFEL_PROGRAM."
        )
    return found


def run(command, feedback):
    """Runs the program, passes its notes to the log, and stops it if the user cancels."""
    command = [program(), *command]
    feedback.pushCommandInfo(" ".join(command))
    last = ""
    # Notes go to stderr, one a line. Both streams share a pipe, so that neither fills up.
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT}
    with subprocess.Popen(command, **pipes, text=True, errors="replace") as process:
        for line in process.stdout:
            last = line.strip() or last
            feedback.pushInfo(line.rstrip())
            if feedback.isCanceled():
                process.terminate()
    if process.returncode != 0 and not feedback.isCanceled():
        raise QgsProcessingException(f"surfel ended with code {process.returncode}: {last}")
