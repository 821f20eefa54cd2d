//! The configuration as JSON: defaults, checks and TOML for `sympose.config`.

use pyo3::prelude::*;

use super::{errors, json};
use crate::config::Config;

/// Every setting with its default, as JSON.
#[pyfunction]
pub(super) fn default_config(py: Python<'_>) -> PyResult<String> {
    json::to_text(py, &Config::default())
}

/// The settings of the paper's method, as JSON.
#[pyfunction]
pub(super) fn paper_config(py: Python<'_>) -> PyResult<String> {
    json::to_text(py, &Config::paper())
}

/// Check settings given as JSON; return all of them, as JSON.
#[pyfunction]
pub(super) fn check_config(py: Python<'_>, config: &str) -> PyResult<String> {
    json::to_text(py, &parse(py, config)?)
}

/// The TOML of settings given as JSON. Settings without a value are left out; those that have one by default are off.
#[pyfunction]
pub(super) fn config_to_toml(py: Python<'_>, config: &str) -> PyResult<String> {
    let text = |config: &Config| -> Result<String, Box<dyn std::error::Error>> {
        let mut table = toml::Table::try_from(config)?;
        switch_off(&mut table, &toml::Table::try_from(Config::default())?);
        Ok(toml::to_string(&table)?)
    };
    text(&parse(py, config)?).map_err(|error| errors::invalid_input(py, error.to_string()))
}

/// Names the settings that `defaults` has and the table lacks: TOML knows no null.
fn switch_off(table: &mut toml::Table, defaults: &toml::Table) {
    for (name, default) in defaults {
        match (table.get_mut(name), default) {
            (Some(toml::Value::Table(group)), toml::Value::Table(defaults)) => switch_off(group, defaults),
            (Some(_), _) => {}
            (None, _) => {
                table.insert(name.clone(), "off".into());
            }
        }
    }
}

/// A checked configuration from JSON.
pub(super) fn parse(py: Python<'_>, config: &str) -> PyResult<Config> {
    // By way of a value, since the line and column of JSON that nobody wrote would only confuse.
    let value: serde_json::Value =
        serde_json::from_str(config).map_err(|error| errors::invalid_input(py, error.to_string()))?;
    let config: Config = serde_path_to_error::deserialize(value).map_err(|error| {
        let message = in_words(&error.inner().to_string());
        errors::invalid_input(py, format!("{}: {message}", error.path()))
    })?;
    config.validate().map_err(|error| errors::exception(py, error))?;
    Ok(config)
}

/// A message of serde with the types of Rust in words.
fn in_words(message: &str) -> String {
    const WORDS: [(&str, &str); 4] = [
        ("expected usize", "expected a whole number, 0 or more"),
        ("expected u32", "expected a whole number, 0 or more"),
        ("expected u64", "expected a whole number, 0 or more"),
        ("expected f64", "expected a number"),
    ];
    WORDS.iter().fold(message.to_owned(), |message, (name, words)| message.replace(name, words))
}
