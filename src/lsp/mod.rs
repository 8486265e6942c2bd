//! `piola lsp`: what an editor asks of the potentials and scenes in it, by the language server protocol.
//!
//! | module | what |
//! |---|---|
//! | [`text`] | open texts and places in them |
//! | [`beside`] | what takes long, in a thread of its own |
//! | [`findings`] | diagnostics while typing, and the repairs that their helps name |
//! | [`potential`] | hover, completion, definitions, names of potentials |
//! | [`scene`] | the same of scenes |
//!
//! One thread answers in the order of the messages. Findings are looked for where no message waits, so that a
//! keystroke is never behind the one before it, and what is told is always about the text as it is. Where
//! the first look at a text takes long its lints are looked for beside from then on.

mod beside;
mod findings;
mod potential;
mod scene;
mod text;

use std::collections::{BTreeMap, BTreeSet};
use std::error::Error;
use std::time::{Duration, Instant};

use lsp_server::{Connection, ErrorCode, Message, Notification, Request, RequestId, Response};
use lsp_types::notification::{
    DidChangeTextDocument, DidCloseTextDocument, DidOpenTextDocument, DidSaveTextDocument,
    Notification as _, PublishDiagnostics,
};
use lsp_types::request::{
    CodeActionRequest, Completion, DocumentSymbolRequest, Formatting, GotoDefinition, HoverRequest,
    PrepareRenameRequest, References, Rename, Request as _,
};
use lsp_types::{
    CodeActionKind, CodeActionOptions, CompletionOptions, HoverProviderCapability,
    InitializeParams, InitializeResult, OneOf, PublishDiagnosticsParams, RenameOptions,
    ServerCapabilities, ServerInfo, TextDocumentPositionParams, TextDocumentSyncCapability,
    TextDocumentSyncKind, TextEdit, Uri,
};

use crate::command::Exit;
use crate::render;
use beside::Beside;
use text::{Document, Encoding, Kind};

pub(crate) fn execute() -> Exit {
    let (connection, threads) = Connection::stdio();
    let served = serve(&connection);
    drop(connection);
    let ended = threads.join().map_err(Into::into);
    match served.and(ended) {
        Ok(()) => Exit::Done,
        Err(error) => {
            render::error(&format!("the editor's messages cannot be followed: {error}"), None);
            Exit::Input
        }
    }
}

fn serve(connection: &Connection) -> Result<(), Box<dyn Error + Send + Sync>> {
    let (id, params) = connection.initialize_start()?;
    let params: InitializeParams = serde_json::from_value(params)?;
    let offered = params.capabilities.general.and_then(|general| general.position_encodings);
    let encoding = Encoding::of(&offered.unwrap_or_default());
    let result = InitializeResult {
        capabilities: capabilities(encoding),
        server_info: Some(ServerInfo {
            name: "piola".to_string(),
            version: Some(env!("CARGO_PKG_VERSION").to_string()),
        }),
    };
    connection.initialize_finish(id, serde_json::to_value(result)?)?;
    let mut server = Server {
        encoding,
        documents: BTreeMap::new(),
        changed: BTreeSet::new(),
        beside: Beside::start(connection),
    };
    loop {
        let message = match server.changed.is_empty() {
            true => connection.receiver.recv().ok(),
            false => match connection.receiver.try_recv() {
                Ok(message) => Some(message),
                Err(error) if error.is_disconnected() => None,
                Err(_) => {
                    server.look(connection)?;
                    continue;
                }
            },
        };
        match message {
            // The editor is gone.
            None => return Ok(()),
            Some(Message::Request(request)) => {
                if connection.handle_shutdown(&request)? {
                    return Ok(());
                }
                connection.sender.send(server.answer(request).into())?;
            }
            Some(Message::Notification(notification)) => server.heed(notification, connection)?,
            Some(Message::Response(_)) => {}
        }
    }
}

fn capabilities(encoding: Encoding) -> ServerCapabilities {
    ServerCapabilities {
        position_encoding: Some(encoding.kind()),
        text_document_sync: Some(TextDocumentSyncCapability::Kind(
            TextDocumentSyncKind::INCREMENTAL,
        )),
        hover_provider: Some(HoverProviderCapability::Simple(true)),
        completion_provider: Some(CompletionOptions {
            trigger_characters: Some(["\"", "[", "{", "="].map(str::to_string).to_vec()),
            ..CompletionOptions::default()
        }),
        definition_provider: Some(OneOf::Left(true)),
        references_provider: Some(OneOf::Left(true)),
        document_symbol_provider: Some(OneOf::Left(true)),
        document_formatting_provider: Some(OneOf::Left(true)),
        rename_provider: Some(OneOf::Right(RenameOptions {
            prepare_provider: Some(true),
            work_done_progress_options: Default::default(),
        })),
        code_action_provider: Some(
            CodeActionOptions {
                code_action_kinds: Some(vec![CodeActionKind::QUICKFIX]),
                ..CodeActionOptions::default()
            }
            .into(),
        ),
        ..ServerCapabilities::default()
    }
}

struct Server {
    encoding: Encoding,
    documents: BTreeMap<String, Document>,
    /// Those whose findings are not told yet.
    changed: BTreeSet<String>,
    beside: Beside,
}

/// Errors are told before lints where looking for these takes longer.
const LONG: Duration = Duration::from_millis(25);

impl Server {
    fn document(&self, uri: &Uri) -> Option<&Document> {
        self.documents.get(uri.as_str())
    }

    /// Tells the findings of one text that has changed.
    fn look(&mut self, connection: &Connection) -> Result<(), Box<dyn Error + Send + Sync>> {
        let uri = self.changed.pop_first().unwrap_or_default();
        let Some(document) = self.documents.get_mut(&uri) else { return Ok(()) };
        let start = Instant::now();
        let found = match document.lints_slowly {
            true => findings::errors_of(document),
            false => findings::of(document),
        };
        if document.lints_slowly && found.is_empty() {
            self.beside.lint(document);
        } else if !document.lints_slowly {
            document.lints_slowly = start.elapsed() > LONG;
        }
        Ok(connection.sender.send(told(document, found).into())?)
    }

    fn heed(
        &mut self,
        notification: Notification,
        connection: &Connection,
    ) -> Result<(), Box<dyn Error + Send + Sync>> {
        let params = notification.params;
        match notification.method.as_str() {
            DidOpenTextDocument::METHOD => {
                let Some(opened) = read::<DidOpenTextDocument>(params) else {
                    return Ok(());
                };
                let item = opened.text_document;
                let key = item.uri.as_str().to_string();
                let document = Document::new(item.uri, item.text, item.version, self.encoding);
                self.beside.changed(&key, true);
                self.documents.insert(key.clone(), document);
                self.changed.insert(key);
            }
            DidChangeTextDocument::METHOD => {
                let Some(changed) = read::<DidChangeTextDocument>(params) else {
                    return Ok(());
                };
                let key = changed.text_document.uri.as_str().to_string();
                if let Some(document) = self.documents.get_mut(&key) {
                    changed.content_changes.into_iter().for_each(|change| document.change(change));
                    document.version = changed.text_document.version;
                    self.beside.changed(&key, true);
                    self.changed.insert(key);
                }
            }
            // What others name has changed.
            DidSaveTextDocument::METHOD => self.changed.extend(self.documents.keys().cloned()),
            DidCloseTextDocument::METHOD => {
                let Some(closed) = read::<DidCloseTextDocument>(params) else {
                    return Ok(());
                };
                let key = closed.text_document.uri.as_str();
                self.documents.remove(key);
                self.changed.remove(key);
                self.beside.changed(key, false);
                let nothing = published(closed.text_document.uri, Vec::new(), None);
                connection.sender.send(nothing.into())?;
            }
            _ => {}
        }
        Ok(())
    }

    fn answer(&self, request: Request) -> Response {
        let of = |place: &TextDocumentPositionParams| {
            let document = self.document(&place.text_document.uri)?;
            Some((document, document.kind(), document.offset(place.position)))
        };
        match request.method.as_str() {
            HoverRequest::METHOD => reply::<HoverRequest>(request, |params| {
                match of(&params.text_document_position_params)? {
                    (document, Kind::Potential, at) => {
                        potential::hover(document, at, &|| self.beside.measured(document))
                    }
                    (document, Kind::Scene, at) => scene::hover(document, at),
                    _ => None,
                }
            }),
            Completion::METHOD => reply::<Completion>(request, |params| {
                let items = match of(&params.text_document_position)? {
                    (document, Kind::Potential, at) => potential::completion(document, at),
                    (document, Kind::Scene, at) => scene::completion(document, at),
                    _ => return None,
                };
                Some(items.into())
            }),
            GotoDefinition::METHOD => reply::<GotoDefinition>(request, |params| {
                let place = match of(&params.text_document_position_params)? {
                    (document, Kind::Potential, at) => potential::definition(document, at),
                    (document, Kind::Scene, at) => scene::definition(document, at),
                    _ => None,
                };
                place.map(Into::into)
            }),
            References::METHOD => reply::<References>(request, |params| {
                let (document, kind, at) = of(&params.text_document_position)?;
                let spans = names(document, kind, at)?.into_iter();
                let place =
                    |span| lsp_types::Location::new(document.uri.clone(), document.range(span));
                Some(spans.map(place).collect())
            }),
            PrepareRenameRequest::METHOD => reply::<PrepareRenameRequest>(request, |place| {
                let (document, kind, at) = of(&place)?;
                let spans = names(document, kind, at)?;
                let here = spans
                    .into_iter()
                    .find(|span| (span.start..=span.end).contains(&(at as u32)))?;
                Some(lsp_types::PrepareRenameResponse::Range(document.range(here)))
            }),
            Rename::METHOD => self.rename(request),
            DocumentSymbolRequest::METHOD => reply::<DocumentSymbolRequest>(request, |params| {
                let document = self.document(&params.text_document.uri)?;
                let is_potential = document.kind() == Kind::Potential;
                is_potential.then(|| potential::symbols(document).into())
            }),
            Formatting::METHOD => reply::<Formatting>(request, |params| {
                let document = self.document(&params.text_document.uri)?;
                let is_potential = document.kind() == Kind::Potential;
                let text = is_potential.then(|| piola_grammar::format(&document.text).ok())??;
                let is_same = text == document.text;
                Some(if is_same { Vec::new() } else { vec![TextEdit::new(document.whole(), text)] })
            }),
            CodeActionRequest::METHOD => reply::<CodeActionRequest>(request, |params| {
                let document = self.document(&params.text_document.uri)?;
                Some(findings::repairs(document, params.range))
            }),
            _ => {
                let message = format!("`{}` is not answered", request.method);
                Response::new_err(request.id, ErrorCode::MethodNotFound as i32, message)
            }
        }
    }

    fn rename(&self, request: Request) -> Response {
        let id = request.id.clone();
        let params = match serde_json::from_value::<lsp_types::RenameParams>(request.params) {
            Ok(params) => params,
            Err(error) => return refused(id, error.to_string()),
        };
        let place = &params.text_document_position;
        let Some(document) = self.document(&place.text_document.uri) else {
            return refused(id, "the file is not open".to_string());
        };
        let (kind, at) = (document.kind(), document.offset(place.position));
        let spans = names(document, kind, at).unwrap_or_default();
        let new = &params.new_name;
        let checked = match kind {
            Kind::Potential => {
                let old = spans.first().map_or("", |span| &document.text[span.range()]);
                potential::check_name(document, old, new)
            }
            _ => scene::check_name(document, new),
        };
        let checked = match spans.is_empty() {
            true => Err("there is no name of yours here".to_string()),
            false => checked.and_then(|()| findings::check_renamed(document, &spans, new)),
        };
        match checked {
            Err(message) => refused(id, message),
            Ok(()) => {
                let edit = |span| TextEdit::new(document.range(span), new.clone());
                let edits = spans.into_iter().map(edit).collect();
                Response::new_ok(id, findings::edit(document, edits))
            }
        }
    }
}

/// What a message says; one that says nothing is told of and passed over.
fn read<N: lsp_types::notification::Notification>(params: serde_json::Value) -> Option<N::Params> {
    let told = |error| render::warning(&format!("a message of the editor cannot be read: {error}"));
    serde_json::from_value(params).map_err(told).ok()
}

/// Every place of the name at a place, if it is one of the user's.
fn names(document: &Document, kind: Kind, at: usize) -> Option<Vec<piola_grammar::Span>> {
    match kind {
        Kind::Potential => potential::places(document, at),
        Kind::Scene => scene::places(document, at),
        Kind::Other => None,
    }
}

fn reply<R: lsp_types::request::Request>(
    request: Request,
    answer: impl FnOnce(R::Params) -> R::Result,
) -> Response {
    match serde_json::from_value::<R::Params>(request.params) {
        Ok(params) => Response::new_ok(request.id, answer(params)),
        Err(error) => refused(request.id, error.to_string()),
    }
}

fn refused(id: RequestId, message: String) -> Response {
    Response::new_err(id, ErrorCode::InvalidParams as i32, message)
}

/// The findings about a text as it is, for the editor.
fn told(document: &Document, found: Vec<findings::Found>) -> Notification {
    let found = found.into_iter().map(|found| found.diagnostic).collect();
    published(document.uri.clone(), found, Some(document.version))
}

fn published(
    uri: Uri,
    diagnostics: Vec<lsp_types::Diagnostic>,
    version: Option<i32>,
) -> Notification {
    let params = PublishDiagnosticsParams::new(uri, diagnostics, version);
    Notification::new(PublishDiagnostics::METHOD.to_string(), params)
}
