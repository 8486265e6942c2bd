//! What is varied: keys of a scene and their values.

use super::SweepError;
use crate::trade::axes::separate;

/// Most runs of one study.
pub const MOST_RUNS: usize = 10_000;

/// A key of a scene and the values that it takes one after the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Variation {
    /// The key, as `--set` has it.
    pub key: String,
    /// Its values, as `--set` has them.
    pub values: Vec<String>,
}

/// The word behind a range whose values grow by factors.
const LOGARITHMIC: &str = "log";

impl Variation {
    /// `KEY=FIRST:LAST:COUNT`, values from the first to the last at even steps, or with `:log` behind it by
    /// even factors; or `KEY=VALUE,VALUE`. A name without a dot is a parameter of `[material]`.
    ///
    /// # Errors
    /// Anything else, with what to write.
    pub fn parse(text: &str) -> Result<Variation, SweepError> {
        let wrong = |reason: &str| SweepError::Variation {
            text: text.to_string(),
            reason: reason.to_string(),
        };
        let (key, values) = text.split_once('=').ok_or_else(|| wrong("it has no `=`"))?;
        let key = match key.trim() {
            "" => return Err(wrong("it names no key")),
            name if name.contains('.') => name.to_string(),
            name => format!("material.parameters.{name}"),
        };
        let values = match range(values) {
            Some(read) => read.map_err(|reason| wrong(&reason))?,
            None => separate(values).into_iter().map(String::from).collect(),
        };
        if values.iter().any(String::is_empty) {
            return Err(wrong("a value is empty"));
        }
        Ok(Variation { key, values })
    }

    /// The last part of the key: what its column and its axis are called.
    pub fn name(&self) -> &str {
        let mut from = self.key.rfind('.').map_or(0, |dot| dot + 1);
        // Entries of lists by the name of the list, too: `u.1`.
        while from > 1 && self.key[from..].starts_with(|c: char| c.is_ascii_digit()) {
            from = self.key[..from - 1].rfind('.').map_or(0, |dot| dot + 1);
        }
        &self.key[from..]
    }

    /// The values as numbers, if all are.
    pub fn numbers(&self) -> Option<Vec<f64>> {
        let number = |value: &String| value.parse::<f64>().ok().filter(|x| x.is_finite());
        self.values.iter().map(number).collect()
    }
}

/// The values of a range; `None` if the text is none.
fn range(text: &str) -> Option<Result<Vec<String>, String>> {
    if !text.contains(':') || text.contains(['"', '[', '{', ',']) {
        return None;
    }
    let wrong = || {
        let form = "a range is FIRST:LAST:COUNT or FIRST:LAST:COUNT:log, of numbers without units";
        Some(Err(form.to_string()))
    };
    let parts: Vec<&str> = text.split(':').map(str::trim).collect();
    let (numbers, logarithmic) = match parts[..] {
        [first, last, count] => ([first, last, count], false),
        [first, last, count, LOGARITHMIC] => ([first, last, count], true),
        _ => return wrong(),
    };
    let [first, last] = [numbers[0], numbers[1]].map(|text| text.parse::<f64>().ok());
    let (Some(first), Some(last)) = (first, last) else { return wrong() };
    let Some(count) = numbers[2].parse::<usize>().ok().filter(|n| (2..=MOST_RUNS).contains(n))
    else {
        return Some(Err(format!("`{}` is no count from 2 to {MOST_RUNS}", numbers[2])));
    };
    if !(first.is_finite() && last.is_finite() && (last - first).is_finite()) {
        return Some(Err("its ends are no finite numbers".to_string()));
    }
    if logarithmic && !(first > 0.0 && last > 0.0) {
        return Some(Err("values that grow by factors are greater than 0".to_string()));
    }
    let value = |k: usize| {
        let along = k as f64 / (count - 1) as f64;
        let between = if logarithmic {
            first * libm::pow(last / first, along)
        } else {
            first + (last - first) * along
        };
        // The ends are what was written, and what lies between has no more digits than are meant.
        match k {
            0 => written(first),
            _ if k + 1 == count => written(last),
            _ => written(format!("{between:.12e}").parse().unwrap_or(between)),
        }
    };
    Some(Ok((0..count).map(value).collect()))
}

/// A number as TOML has it: with an exponent where it is long without, else as it is, which may be a count.
fn written(x: f64) -> String {
    match x == 0.0 || (1e-4..1e6).contains(&x.abs()) {
        true => x.to_string(),
        false => format!("{x:e}"),
    }
}

/// Every combination of the values, the last key fastest; of each the values of the keys.
///
/// # Errors
/// No variation, a key that is varied twice, more runs than [`MOST_RUNS`].
pub(super) fn combinations(variations: &[Variation]) -> Result<Vec<Vec<String>>, SweepError> {
    if variations.is_empty() {
        return Err(SweepError::Nothing);
    }
    for (place, variation) in variations.iter().enumerate() {
        if variations[..place].iter().any(|other| other.key == variation.key) {
            return Err(SweepError::Variation {
                text: variation.key.clone(),
                reason: "it is varied twice".to_string(),
            });
        }
    }
    let counts = variations.iter().map(|variation| variation.values.len());
    let found = counts.fold(1_usize, usize::saturating_mul);
    if found > MOST_RUNS {
        return Err(SweepError::TooMany { found });
    }
    let mut all: Vec<Vec<String>> = vec![Vec::new()];
    for variation in variations {
        let longer = |before: &Vec<String>| {
            let before = before.clone();
            let with = move |value: &String| {
                before.iter().cloned().chain([value.clone()]).collect::<Vec<String>>()
            };
            variation.values.iter().map(with).collect::<Vec<Vec<String>>>()
        };
        all = all.iter().flat_map(longer).collect();
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(text: &str) -> Vec<String> {
        Variation::parse(text).unwrap().values
    }

    #[test]
    fn ranges_and_lists_are_read() {
        assert_eq!(values("C2=0:200:5"), ["0", "50", "100", "150", "200"]);
        assert_eq!(values("C2=0:0.3:4"), ["0", "0.1", "0.2", "0.3"]);
        assert_eq!(values("C2=1e6:1e9:4:log"), ["1e6", "1e7", "1e8", "1e9"]);
        assert_eq!(values("material.potential=a,b.piola"), ["a", "b.piola"]);
        assert_eq!(values("prescribe.0.u=[0, \"t\"],[0, 1]"), ["[0, \"t\"]", "[0, 1]"]);
        assert_eq!(values("E=1 GPa,2 GPa"), ["1 GPa", "2 GPa"]);
        assert_eq!(Variation::parse("C2=1,2").unwrap().key, "material.parameters.C2");
        assert_eq!(Variation::parse("body.spacing=0.1,0.05").unwrap().name(), "spacing");
        assert_eq!(Variation::parse("prescribe.1.u.0=0,1").unwrap().name(), "u.0");
    }

    #[test]
    fn what_is_no_variation_is_refused() {
        for (text, reason) in [
            ("C2", "no `=`"),
            ("=1,2", "no key"),
            ("C2=", "empty"),
            ("C2=1,,2", "empty"),
            ("C2=0:1:1", "no count from 2"),
            ("C2=0:1:x", "no count from 2"),
            ("C2=0:1:99999", "no count from 2"),
            ("C2=0:inf:3", "no finite"),
            ("C2=0:1:3:log", "greater than 0"),
            ("C2=0:1", "FIRST:LAST:COUNT"),
            ("C2=1 MPa:2 MPa:3", "without units"),
            ("C2=0:1:3:lin", "FIRST:LAST:COUNT:log"),
        ] {
            let error = Variation::parse(text).unwrap_err();
            assert!(error.to_string().contains(reason), "{text}: {error}");
        }
        let one = |text: &str| Variation::parse(text).unwrap();
        assert!(combinations(&[]).is_err());
        assert!(combinations(&[one("a.b=1"), one("a.b=2")]).is_err());
        assert!(combinations(&[one("a.b=0:1:9999"), one("a.c=1,2")]).is_err());
        let all = combinations(&[one("a.b=1,2"), one("a.c=x,y")]).unwrap();
        assert_eq!(all, [["1", "x"], ["1", "y"], ["2", "x"], ["2", "y"]]);
    }
}
