//! Who runs the service, as its pages tell readers.

/// Who runs the service. What is not told is unknown to readers too.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Operator {
    /// Name of a person or an institution.
    pub name: Option<String>,
    /// Where to write to.
    pub contact: Option<Contact>,
}

/// Where the operator can be reached.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Contact {
    /// The address as the operator wrote it.
    pub shown: String,
    /// The address as a link.
    pub link: String,
}

impl Contact {
    /// Reads an email address, or the address of a page.
    ///
    /// # Errors
    /// Returns what is expected, if it is neither.
    pub fn read(text: &str) -> Result<Self, &'static str> {
        let text = text.trim();
        let is_clean = !text.contains(|c: char| c.is_whitespace() || c.is_control());
        let is_page = text.starts_with("https://") || text.starts_with("http://");
        let is_mail = text.split_once('@').is_some_and(|(user, host)| {
            !user.is_empty() && host.contains('.') && !text.contains(['/', '?', ':', '<', '>'])
        });
        let link = match (is_page, is_mail) {
            (true, _) => text.to_owned(),
            (false, true) => format!("mailto:{text}"),
            (false, false) => String::new(),
        };
        if link.is_empty() || !is_clean {
            return Err(
                "expected an email address, such as board@lab.example, or the address of a page, such as https://lab.example/contact",
            );
        }
        Ok(Self { shown: text.to_owned(), link })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn contacts_are_addresses_of_mail_or_of_pages() {
        for (text, link) in [
            ("board@lab.example", Some("mailto:board@lab.example")),
            (" https://lab.example/contact ", Some("https://lab.example/contact")),
            ("javascript:alert(1)@x.y", None),
            ("board@lab", None),
            ("board@lab.example?subject=x", None),
            ("https://lab.example/a b", None),
            ("ask Ada", None),
            ("", None),
        ] {
            assert_eq!(Contact::read(text).ok().map(|contact| contact.link).as_deref(), link, "{text}");
        }
    }
}
