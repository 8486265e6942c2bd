//! Compiles the C side of the crate against the PETSc of the machine, where the feature asks for it.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    #[cfg(feature = "petsc")]
    shim::build();
}

#[cfg(feature = "petsc")]
mod shim {
    use std::path::PathBuf;
    use std::process::Command;

    /// The oldest PETSc that the shim is written for.
    const OLDEST: &str = "3.18";

    /// What a machine without PETSc is told.
    const REMEDY: &str = "apt-get install petsc-dev libopenmpi-dev on Debian, or set \
                          PKG_CONFIG_PATH to the lib/pkgconfig of your own build";

    pub(crate) fn build() {
        let petsc = library("PETSc", Some(OLDEST))
            .or_else(|_| library("petsc", Some(OLDEST)))
            .unwrap_or_else(|error| panic!("PETSc was not found: {REMEDY}\n{error}"));
        let mut build = cc::Build::new();
        let mut includes = petsc.include_paths;
        // Headers of PETSc refuse those of an MPI that it was not built with.
        let mpi =
            ["mpi-c", "ompi-c", "mpich", "mpi"].iter().find_map(|name| library(name, None).ok());
        match mpi {
            Some(mpi) => includes.extend(mpi.include_paths),
            None if has_mpicc() => {
                build.compiler("mpicc");
                println!("cargo::rustc-link-lib=mpi");
            }
            None => panic!("MPI was not found, neither by pkg-config nor as mpicc: {REMEDY}"),
        }
        let sources = ["engine.c", "halo.c", "newton.c"].map(|name| format!("shim/{name}"));
        for file in sources.iter().map(String::as_str).chain(["shim/shim.h"]) {
            println!("cargo::rerun-if-changed={file}");
        }
        // Headers of a library are no place for warnings of ours, hence as a system's.
        for folder in includes.iter().map(PathBuf::as_path) {
            build.flag("-isystem").flag(folder);
        }
        build.std("c11").warnings(true).files(sources).compile("piola_petsc_shim");
    }

    /// What pkg-config says of a library, told to the linker at once.
    fn library(name: &str, oldest: Option<&str>) -> Result<pkg_config::Library, pkg_config::Error> {
        let mut config = pkg_config::Config::new();
        if let Some(oldest) = oldest {
            config.atleast_version(oldest);
        }
        config.probe(name)
    }

    fn has_mpicc() -> bool {
        Command::new("mpicc").arg("--version").output().is_ok_and(|output| output.status.success())
    }
}
